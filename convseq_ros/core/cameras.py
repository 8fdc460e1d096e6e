# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of one robot, against one map."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.first_stage import Describe
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.online import FollowedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.core.sequence.coarse_scores import Coarse
from convseq_ros.core.types import Frame, Localization, LocalizationState, Match
import numpy as np

_SURER = tuple(LocalizationState)  # the later the surer


class Cameras:
    """
    One recogniser for each camera, told apart by the `source` of frames; a single one takes all.

    What another camera saw is no part of a sequence, nor usual of these images. So cameras share
    nothing but the map, to which the first alone adds, what odometry links to it, and where the
    robot is: what the surest knows. ConfigError as of `PlaceRecognizer`.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config,
        sources: Sequence[str] = (),
        coarse: Callable[[], Coarse | None] = lambda: None,
        describe: Describe | None = None,
    ) -> None:
        """Make what recognises; `coarse` makes what knows coarse scores, for each camera."""
        self.config = config

        def made(number: int) -> PlaceRecognizer:
            own = of_camera(config, number)
            return PlaceRecognizer(reference_map, own, coarse=coarse(), describe=describe)

        self.first = made(0)
        self.recognizers, self._frames = {source: self.first for source in sources[:1]}, 0
        for number, source in enumerate(sources[1:], 1):
            own = made(number)
            own.mapping = FollowedMap(reference_map, self.first.mapping)
            own.decider.share(self.first.decider)
            self.recognizers[source] = own
        if len(sources) > 1:
            x, y, z, *turn = config.robot.of_camera(0).mount
            reference_map.usual_mount = of_roll_pitch_yaw((x, y, z), *turn)

    @property
    def each(self) -> list[PlaceRecognizer]:
        """Every recogniser, the first one first."""
        return [*dict.fromkeys((self.first, *self.recognizers.values()))]

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

    def expect(self, frames: Sequence[Frame]) -> None:
        """Do what `PlaceRecognizer.expect` does, for the frames of each camera."""
        for one in self.each:
            one.expect([frame for frame in frames if self.of(frame.source) is one])

    def warm_up(self) -> None:
        """Load tables, and prepare a small map, so that the first frame is not late."""
        drawn = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
        for one in self.each:
            global_descriptor(describe(drawn, one.reference_map.encoding).cells)
            one.matcher.warm_up()

    @property
    def localization(self) -> Localization:
        """Where the robot is, by the camera that is surest."""
        found = [one.localizer.localization for one in self.each]
        return max(found, key=lambda one: (_SURER.index(one.state), one.quality or 0.0))

    @property
    def resets(self) -> int:
        """How often a clock jumped back."""
        return max(one.resets for one in self.each)

    def configure(self, config: Config) -> None:
        """Go on with other settings."""
        # What the map and its model ask for does not change.
        own = self.config
        reading = replace(config.reading, keeps_color=own.reading.keeps_color)
        config = replace(config, encoding=own.encoding, reading=reading)
        self.config = config
        for number, one in enumerate(self.each):
            one.config = of_camera(config, number)

    def reset(self) -> None:
        """Forget the frames so far, as `PlaceRecognizer.reset` does."""
        for one in self.each:
            one.reset()


def of_camera(config: Config, number: int) -> Config:
    """Return the settings of a camera by its number."""
    return replace(config, robot=config.robot.of_camera(number))
