# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recogniser with the file of its map, which grows with it in online mode."""

from collections.abc import Sequence
from pathlib import Path

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.cameras import Cameras
from convseq_ros.core.compiled import slow_path
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.encoding.view import with_mask_read
from convseq_ros.core.map.autosave import Autosave, NoAutosave
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.errors import MapError
import numpy as np


class Session:
    """
    Opens a map and recognises its places; in online mode, also persists what is added to it.

    In preloaded mode the file must exist and is never written; in online mode it is made if there
    is none, unless not to `make` it. Without a path the map is in memory: empty, and lost at the
    end. `sources` name the cameras, if there are several; `describe` is the model of the map, if
    it is of one. MapError if the map cannot be opened or, in online mode, not be written, or
    another program adds to it.
    """

    def __init__(
        self,
        path: Path | None,
        config: Config,
        make: bool = True,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        self.path = path
        self.is_growing = config.online.grows
        self.is_persisted = path is not None and self.is_growing  # in a file that grows
        self.autosave, self._problem = NoAutosave(), ''  # why the map has more than `max_looks`
        encoding = with_mask_read(config.encoding, config.reading)
        if path is None:
            reference_map = ReferenceMap(encoding, keyframes=config.keyframes)
        elif self.is_growing:
            max_looks = config.online.max_looks
            settings = path, encoding, config.keyframes, None if make else True, True, max_looks
            autosave = Autosave(*settings)
            if autosave.has_surplus:  # since a crash, or of a higher limit
                try:
                    autosave.close()
                except MapError as error:  # as of a disk that is full: the map works as it is
                    self._problem = f'max_looks is ignored: {error}'
                autosave = Autosave(*settings)
            self.autosave, reference_map = autosave, autosave.reference_map
        else:
            reference_map = open_map(path, encoding)
        # Call `save` after every frame.
        self.save, self.flush = self.autosave.save, self.autosave.flush
        self.close = self.autosave.close
        try:
            self.cameras = Cameras(reference_map, config, sources, describe=describe)
        except BaseException:
            self.close()
            raise
        self.recognizer = self.cameras.first  # that of the first camera, which adds to the map
        self.kernel = self.recognizer.matcher.kernel  # what computes pair scores
        # Why that is slow, with the remedy, if nobody asked for it.
        self.slow = '' if config.matching.kernel == 'numpy' else slow_path()
        # Way between the map's keyframes, and so between queries if there is odometry; or 0.
        self.keyframes_m = reference_map.keyframes.keyframe_distance_m

    @property
    def ignored(self) -> list[str]:
        """What does not count, a line each: damaged links, or a spacing that is not the map's."""
        asked, usual = self.recognizer.config.keyframes.spacing, KeyframeConfig().spacing
        own = self.recognizer.reference_map.keyframes.spacing
        problems = self.recognizer.reference_map.problem, self._problem
        return [problem for problem in problems if problem] + [
            f'{name} {asked[name]} is ignored: {self.path} was made with {own[name]}; build the '
            'map again to change it'
            for name in own
            if asked[name] not in (own[name], usual[name])
        ]

    @property
    def added(self) -> int:
        """Places that came in this session."""
        return len(self.recognizer.reference_map) - self.recognizer.mapping.session_start

    def warm_up(self) -> None:
        """Do as `warm_up` does."""
        for one in self.cameras.each:
            warm_up(one)


def warm_up(recognizer: PlaceRecognizer) -> None:
    """Load tables, and prepare a small map, so that the first frame is not late."""
    drawn = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
    global_descriptor(describe(drawn, recognizer.reference_map.encoding).cells)
    recognizer.matcher.warm_up()
