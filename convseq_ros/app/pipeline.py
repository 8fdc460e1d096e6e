# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pipeline: recognisers with the map file that they use and, in online mode, extend."""

from collections.abc import Sequence
from pathlib import Path

from convseq_ros.app.cameras import Cameras
from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.compiled import slow_path
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.map.appender import Appender, MapOwner
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap


class Pipeline:
    """
    Opens a map and recognises its places; in online mode, also adds places and stores them.

    In preloaded mode the file must exist and is never written; in online mode it is made if
    missing, if `make` is True. Without a path the map is in memory: empty, and lost at the end.
    `sources` are the names of the cameras, if there are several; `describe` is the map's
    descriptor model, if it has one. MapError if the map cannot be opened or, in online mode,
    cannot be written, or another program adds to it.
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
        self.is_persisted = path is not None and self.is_growing  # places are added to a file
        self.owner = _opened(path, config, make)
        reference_map = self.owner.reference_map
        self.flush, self.close = self.owner.flush, self.owner.close
        try:
            self.cameras = Cameras(reference_map, config, sources, describe=describe)
        except BaseException:
            self.close()
            raise
        self.recognizer = self.cameras.first  # of the first camera, which adds places
        self.kernel = self.recognizer.matcher.kernel  # name of the kernel of pair scores
        self.slow = slow_path()  # why this kernel is slow, with the remedy
        # Distance between keyframes, of the map and by odometry of queries; 0 without a limit.
        self.keyframes_m = reference_map.keyframes.keyframe_distance_m

    @property
    def ignored(self) -> list[str]:
        """One line for what is ignored: damaged links, another spacing."""
        opened, config = self.recognizer.reference_map, self.recognizer.config
        wanted, default = config.keyframes.spacing, KeyframeConfig().spacing
        used = opened.keyframes.spacing
        return [opened.problem] * bool(opened.problem) + [
            f'{name} {wanted[name]} is ignored: {self.path} was made with {used[name]}; build the '
            'map again to change it'
            for name in used
            if wanted[name] not in (used[name], default[name])
        ]

    @property
    def added(self) -> int:
        """Number of places that were added since the map was opened."""
        return len(self.owner.reference_map) - self.owner.found

    def save(self) -> None:
        """Call this after every frame, as `Appender.save`; a lost file ends the growth."""
        if self.is_growing and self.owner.lost:
            self.is_growing = False
            self.recognizer.mapping.freeze()
        self.owner.save()

    def warm_up(self) -> None:
        """Prepare the cameras, so that the first frame is as fast as the others."""
        self.cameras.warm_up()


def _opened(path: Path | None, config: Config, make: bool) -> MapOwner:
    """Return the owner of a map in a file, or of one in memory."""
    encoding, keyframes = config.encoding, config.keyframes
    if not path:
        return MapOwner(ReferenceMap(encoding, keyframes=keyframes))
    if not config.online.grows:
        return MapOwner(open_map(path, encoding))
    append, most = None if make else True, config.online.max_looks
    return Appender(path, encoding, keyframes, append=append, max_looks=most)
