# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Building a map file from frames: online mapping without recognition."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.frame_gate import FrameGate
from convseq_ros.core.map.autosave import Autosave, NoAutosave
from convseq_ros.core.map.online import OnlineMap
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import MapError


class MapBuilder:
    """
    Adds the keyframes among some frames to a map file; use it as a context manager.

    Places are those that online mode makes of the same frames. What was added is safe after half a
    second, and at the end, also when the work was interrupted.

    Parameters
    ----------
    path : Path, optional
        The file; a new one is made unless `append`. None makes a map in memory.
    config : Config
        How frames are encoded, what keyframes and motion are.
    append : bool
        Add to an existing map, which must have been made with the same settings.

    Attributes
    ----------
    reference_map : ReferenceMap
        The map.

    Raises
    ------
    MapError
        If a new file exists already, an existing one is missing, damaged or made with other
        settings, or the disk is full.

    """

    def __init__(
        self, path: Path | None = None, config: Config = Config(), append: bool = False
    ) -> None:
        if path and append and not path.is_file():
            raise MapError(f'{path}: no such map to append to')
        if path and not append and path.exists():
            raise MapError(f'{path}: exists already; append to it, or delete it first')
        self.reference_map = ReferenceMap(config.encoding, keyframes=config.keyframes)
        if path and append:
            self.reference_map = open_map(path, config.encoding, config.keyframes)
        self._config, self._blank = config, blank_descriptor(config.encoding)
        self._gate = FrameGate(config, config.keyframes, PaperSimilarity(config.matching.kernel))
        self._mapping = OnlineMap(self.reference_map, config)
        self._autosave = Autosave(path, self.reference_map) if path else NoAutosave()
        self._new_path = None if append else path

    @property
    def added(self) -> int:
        """Places that were added."""
        return len(self.reference_map) - self._mapping.session_start

    def process(self, frame: Frame) -> bool:
        """Take in the next frame; return whether it became a place. Unreadable ones never do."""
        if frame.gray is None:
            return False
        gray = frame.gray

        def encode() -> Descriptor:
            return describe(gray, self._config.encoding)

        verdict = self._gate.update(frame.stamp_ns, frame.pose, encode)
        if verdict.reason is None:
            self._mapping.add(frame, verdict.descriptor)
        self._autosave.save()
        return verdict.reason is None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._autosave.close()
        if self._new_path and not self.added:
            self._new_path.unlink()


def build_map(
    frames: Iterable[Frame], path: str | Path | None = None, config: Config = Config()
) -> ReferenceMap:
    """
    Build a map from frames in order, in a file or in memory alone, and return it.

    Raises
    ------
    MapError
        If the file exists already, or cannot be written.

    """
    with MapBuilder(Path(path) if path else None, config) as builder:
        for frame in frames:
            builder.process(frame)
    return builder.reference_map
