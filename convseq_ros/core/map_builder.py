# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Building a map file from frames: online mapping, for the map alone."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Self

from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.frame_gate import AnyOrder
from convseq_ros.core.map.autosave import Autosave, NoAutosave
from convseq_ros.core.map.online import OnlineMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame


class MapBuilder:
    """
    Adds the keyframes among some frames to a map file; use it as a context manager.

    Places are those that online mode makes of the same frames; they are one session, which may
    have a `name`, and its poses a `frame` that others share. What was added is safe after half a
    second, and at the end, also when the work was interrupted. A new file is made unless `append`;
    no path makes a map in memory. MapError if a new file exists already, an existing one is
    missing, damaged, made with other settings or added to by another, or the disk is full.

    Each place is recognised among those before it, as online mode does, for the map's `links`;
    without them, or without cells, nothing is recognised. All keyframes are kept, unless there is
    a limit of `max_looks`. `describe`, from an image to a vector, is the model of the map, if not
    what is built in.
    """

    def __init__(
        self,
        path: Path | None = None,
        config: Config = Config(),
        append: bool = False,
        name: str = '',
        frame: str = '',
        links: bool = True,
        max_looks: int = 0,
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        online = replace(config.online, mode='online', max_looks=max_looks)
        config = replace(config, online=online)
        settings = config.encoding, config.keyframes
        self._autosave = NoAutosave()
        if path:
            self._autosave = autosave = Autosave(path, *settings, append, False, max_looks)
            self.reference_map = autosave.reference_map
        else:
            self.reference_map = ReferenceMap(config.encoding, keyframes=config.keyframes)
        self._recognizer = own = PlaceRecognizer(self.reference_map, config, describe=describe)
        # Whatever the stamps say, it is one session.
        own.order, own.mapping = AnyOrder(), OnlineMap(self.reference_map, config, name, frame)
        own.only_maps = not (links and config.encoding.keeps_cells)

    @property
    def added(self) -> int:
        """Places that were added."""
        return len(self.reference_map) - self._recognizer.mapping.session_start

    @property
    def removed(self) -> int:
        """Places that went at the end, for the limit."""
        return self._autosave.removed

    def process(self, frame: Frame) -> bool:
        """Take in the next frame; return whether it became a place. Unreadable ones never do."""
        if frame.gray is None:
            return False
        before = len(self.reference_map)
        self._recognizer.process(frame)
        self._autosave.save()
        return len(self.reference_map) > before

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._autosave.close()


def build_map(
    frames: Iterable[Frame],
    path: str | Path | None = None,
    config: Config = Config(),
    links: bool = True,
    describe: Describe | None = None,
) -> ReferenceMap:
    """Build a map of frames in order, in a new file or in memory alone; as `MapBuilder` does."""
    file = Path(path) if path else None
    with MapBuilder(file, config, links=links, describe=describe) as builder:
        for frame in frames:
            builder.process(frame)
    return builder.reference_map
