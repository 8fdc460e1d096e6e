# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which files and folders are recordings, by their names."""

from pathlib import Path

from convseq_ros.errors import SourceError
from convseq_ros.io.regular_file import refuse_irregular
from convseq_ros.sources.folder import natural_key, pictures_in
from convseq_ros.sources.storage import is_storage_file
from convseq_ros.sources.video import VIDEO_SUFFIXES


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings, videos and folders of pictures in a folder, bag2 before bag10."""
    refuse_irregular(folder)
    try:
        paths = sorted(folder.iterdir(), key=natural_key)
        if pictures_in(folder) or folder / 'metadata.yaml' in paths:
            raise SourceError(f'{folder}: is a recording itself; name the folder that it lies in')
    except OSError as error:
        raise SourceError(f'{folder}: {error.strerror}; check the path') from None
    recordings = [path for path in paths if not path.name.startswith('.') and _is_recording(path)]
    if not recordings:
        raise SourceError(
            f'{folder}: no recordings in it: no .mcap, .db3, .bag or video, no folder of pictures'
        )
    return recordings


def _is_recording(path: Path) -> bool:
    if path.is_dir():
        return holds_recording(path) or bool(pictures_in(path))
    return is_recording_file(path)


def is_recording_file(path: Path) -> bool:
    """Return whether a name is that of a recording's file, or a video's."""
    return is_storage_file(path) or path.suffix.lower() in VIDEO_SUFFIXES


def holds_recording(folder: Path) -> bool:
    """Return whether a recorder wrote a folder; SourceError if it cannot be read."""
    try:
        files = list(folder.iterdir())
        pictures = pictures_in(folder)
    except OSError as error:
        raise SourceError(f'{folder}: {error.strerror}; check its permissions') from None
    described = folder / 'metadata.yaml' in files
    recorded = any(is_storage_file(file) for file in files)
    return (recorded and described) or (not pictures and (recorded or described))
