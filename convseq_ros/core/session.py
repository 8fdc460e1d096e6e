# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recogniser with the file of its map, which grows with it in online mode."""

from pathlib import Path
import time

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.online import Autosave, NoAutosave
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
import numpy as np


class Session:
    """
    Opens a map and recognises its places; in online mode, also persists what is added to it.

    Parameters
    ----------
    path : Path or None
        The map's file. In preloaded mode it must exist and is never written; in online mode it is
        made if there is none. None is a map in memory: empty, and lost at the end.
    config : Config
        How to recognise, and the mode. `is_growing` says whether it is online.

    Raises
    ------
    MapError
        If the map cannot be opened or, in online mode, not be written.

    """

    def __init__(self, path: Path | None, config: Config) -> None:
        self.path = path
        self.is_growing = config.online.mode == 'online'
        if path is None or (self.is_growing and not path.exists()):
            reference_map = ReferenceMap(config.encoding, keyframes=config.keyframes)
        else:
            added = config.keyframes if self.is_growing else None
            reference_map = open_map(path, config.encoding, added)
        self.committed_s: float | None = None  # monotonic time at which the file grew last
        self._autosave = NoAutosave()
        if path is not None and self.is_growing:
            self._autosave = Autosave(path, reference_map)
        self.recognizer = PlaceRecognizer(reference_map, config)

    @property
    def ignored(self) -> list[str]:
        """What was asked for and does not count, a line each: the map says how far apart."""
        asked, usual = self.recognizer.config.keyframes.spacing, KeyframeConfig().spacing
        own = self.recognizer.reference_map.keyframes.spacing
        return [
            f'{name} {asked[name]} is ignored: {self.path} was made with {own[name]}; build the '
            'map again to change it'
            for name in own
            if asked[name] not in (own[name], usual[name])
        ]

    @property
    def is_persisted(self) -> bool:
        """Whether there is a file that grows."""
        return self.path is not None and self.is_growing

    @property
    def persisted(self) -> int:
        """Places that are safe in the file."""
        return self._autosave.committed

    @property
    def keyframes_m(self) -> float:
        """Way between the map's keyframes, and so between queries if there is odometry; or 0."""
        return self.recognizer.reference_map.keyframes.keyframe_distance_m

    @property
    def added(self) -> int:
        """Places that came in this session."""
        recognizer = self.recognizer
        return len(recognizer.reference_map) - recognizer.mapping.session_start

    @property
    def kernel(self) -> str:
        """What computes pair scores."""
        return self.recognizer.matcher.kernel

    def warm_up(self) -> None:
        """Compile what is compiled at its first use, which may take seconds."""
        encoding = self.recognizer.config.encoding
        drawn = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
        self.recognizer.gate.warm_up(describe(drawn, encoding))
        self.recognizer.matcher.warm_up()

    def save(self) -> None:
        """
        Write to the file what was added to the map; call it after every frame.

        MapError, once, if it cannot be written: the map goes on in memory, later calls try again.
        """
        before = self._autosave.committed
        self._autosave.save()
        if self._autosave.committed > before:
            self.committed_s = time.monotonic()

    def close(self) -> None:
        """Make all that was added safe and close the file; MapError if it cannot be written."""
        self._autosave.close()
