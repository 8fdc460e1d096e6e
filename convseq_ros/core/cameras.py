# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of one robot, against one map."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.map.online import FollowedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.core.types import Frame, Localization, LocalizationState, Match

_SURER = tuple(LocalizationState)  # the later the surer


class Cameras:
    """
    One recogniser for each camera, told apart by the `source` of frames; a single one takes all.

    What another camera saw is no part of a sequence, nor usual of these images. So cameras share
    nothing but the map, to which the first alone adds, and where the robot is: what the surest
    knows. ConfigError as of `PlaceRecognizer`.
    """

    def __init__(
        self, reference_map: ReferenceMap, config: Config, sources: Sequence[str] = ()
    ) -> None:
        self.config = config
        self.first = PlaceRecognizer(reference_map, _of_camera(config, 0))
        self.recognizers, self._frames = {source: self.first for source in sources[:1]}, 0
        for number, source in enumerate(sources[1:], 1):
            own = PlaceRecognizer(reference_map, _of_camera(config, number))
            own.mapping = FollowedMap(reference_map, self.first.mapping)
            self.recognizers[source] = own
        if len(sources) > 1:
            x, y, z, *turn = config.robot.of_camera(0).mount
            reference_map.usual_mount = of_roll_pitch_yaw((x, y, z), *turn)

    def of(self, source: str) -> PlaceRecognizer:
        """Return what recognises the frames of a source."""
        return self.recognizers.get(source, self.first)

    def process(self, frame: Frame) -> Match:
        """Return what `PlaceRecognizer.process` does, and which camera it was, of several."""
        match = self.of(frame.source).process(frame)
        if len(self.recognizers) < 2:
            return match
        self._frames += 1
        known = replace(match, query_index=self._frames - 1, localization=self.localization)
        return replace(known, camera=frame.source)

    @property
    def localization(self) -> Localization:
        """Where the robot is, by the camera that is surest."""
        found = [one.localizer.localization for one in self.recognizers.values()]
        found = found or [self.first.localizer.localization]
        return max(found, key=lambda one: (_SURER.index(one.state), one.quality or 0.0))

    @property
    def resets(self) -> int:
        """How often a clock jumped back."""
        return max(one.resets for one in (self.first, *self.recognizers.values()))

    def configure(self, config: Config) -> None:
        """Go on with other settings."""
        self.config = config
        self.first.config = _of_camera(config, 0)
        for number, one in enumerate(self.recognizers.values()):
            one.config = _of_camera(config, number)

    def reset(self) -> None:
        """Forget the frames so far, as `PlaceRecognizer.reset` does."""
        for one in dict.fromkeys((self.first, *self.recognizers.values())):
            one.reset()


def _of_camera(config: Config, number: int) -> Config:
    return replace(config, robot=config.robot.of_camera(number))
