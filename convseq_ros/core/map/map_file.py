# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map on disk: one SQLite file, append-only, never changed by opening it."""

import os
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.map_reader import MapReader
from convseq_ros.core.map.map_writer import MapWriter
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError


def open_map(
    path: Path, encoding: EncodingConfig | None = None, keyframes: KeyframeConfig | None = None
) -> ReferenceMap:
    """
    Read a map: all that is searched in; cells and thumbnails when they are asked for.

    Parameters
    ----------
    path : Path
        The file; it is not changed, and must stay where it is while the map is used.
    encoding : EncodingConfig, optional
        How query images will be encoded; without it the map's own settings are taken.
    keyframes : KeyframeConfig, optional
        How far apart those will be that are added; without it the map's own settings are taken.

    Raises
    ------
    MapError
        If the file is missing, foreign, damaged, of another format or made with other settings.
        Damaged cells are found when they are read.

    """
    reader = MapReader(path, encoding, keyframes)
    return ReferenceMap(reader.encoding, reader.columns(), reader, reader.keyframes)


def save_map(reference_map: ReferenceMap, path: Path) -> None:
    """
    Write a map as it is now, replacing the file in one step.

    Raises
    ------
    MapError
        If it cannot be written; an existing file is then unchanged.

    """
    part = path.with_name(path.name + '.part')
    try:
        part.unlink(missing_ok=True)
        with MapWriter(part, reference_map.encoding, keyframes=reference_map.keyframes) as writer:
            copy_places(reference_map, writer, len(reference_map))
        os.replace(part, path)
    except (MapError, OSError) as error:
        part.unlink(missing_ok=True)
        raise MapError(f'{path}: cannot write the map ({error})') from error


def copy_places(reference_map: ReferenceMap, writer: MapWriter, end: int) -> None:
    """Write the places that follow those that a writer has, up to before `end`."""
    for index in range(len(writer), end):
        writer.add(
            reference_map.place(index),
            reference_map.packed(index),
            reference_map.thumbnail(index),
            reference_map.pooled[index],
        )


def describe_file(path: Path) -> dict[str, Any]:
    """Return what a map file says about itself: settings, the tool that made it, thumbnails."""
    return MapReader(path).about()
