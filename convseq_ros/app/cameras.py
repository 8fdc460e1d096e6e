# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of a robot, which are matched with the same map."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.first_stage import Describe
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.core.types import (
    Frame,
    Localization,
    LocalizationState,
    Match,
    PoseEstimate,
    ROBOT,
)
import numpy as np

_ASCENDING = tuple(LocalizationState)  # by certainty


class Cameras:
    """
    One recogniser for each camera, chosen by the `source` of a frame; a single one takes all.

    Sequences and image statistics belong to one camera. Cameras share the map, to which only the
    first one adds places, and the position by odometry; the most certain camera localises the
    robot. ConfigError as of `PlaceRecognizer`.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config.robot.refuse_count(len(sources) or 1)
        self.config = config

        def make(number: int, leader: PlaceRecognizer | None = None) -> PlaceRecognizer:
            settings = of_camera(config, number)
            return PlaceRecognizer(reference_map, settings, describe=describe, leader=leader)

        self.first = make(0)
        self.recognizers, self._frames = {source: self.first for source in sources[:1]}, 0
        for number, source in enumerate(sources[1:], 1):
            self.recognizers[source] = make(number, self.first)
        self._set_usual_mount()

    @property
    def each(self) -> list[PlaceRecognizer]:
        """All recognisers, in the order of the cameras."""
        return [*dict.fromkeys((self.first, *self.recognizers.values()))]

    def of(self, source: str) -> PlaceRecognizer:
        """Return the recogniser of a source's frames."""
        return self.recognizers.get(source, self.first)

    def process(self, frame: Frame) -> Match:
        """Return the match of `PlaceRecognizer.process`, with the camera's name if several."""
        match = self.of(frame.source).process(frame)
        if len(self.recognizers) < 2:
            return match
        self._frames += 1
        match = replace(match, query_index=self._frames - 1, localization=self.localization)
        return replace(match, camera=frame.source)

    def warm_up(self) -> None:
        """Load tables, and prepare a small map, so that the first frame is not late."""
        image = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
        for recognizer in self.each:
            global_descriptor(describe(image, recognizer.reference_map.encoding).cells)
            recognizer.matcher.warm_up()

    @property
    def localization(self) -> Localization:
        """The localization of the most certain camera."""
        candidates = [recognizer.localizer.localization for recognizer in self.each]
        return max(candidates, key=lambda it: (_ASCENDING.index(it.state), it.quality or 0.0))

    @property
    def odometry_jumps(self) -> int:
        """Number of steps of odometry that no robot can have made."""
        return max(recognizer.decider.odometry_jumps for recognizer in self.each)

    @property
    def notes(self) -> list[str]:
        """Where cameras are, one line each, if it is not known otherwise."""
        return self._each_said(lambda recognizer: recognizer.camera_check.note)

    @property
    def problems(self) -> list[str]:
        """What is wrong with cameras, odometry and stamps, one line each."""
        lines = self._each_said(lambda recognizer: recognizer.camera_check.problem)
        lines += self._each_said(lambda recognizer: recognizer.view.problem)
        if self.odometry_jumps:
            lines.append(
                f'odometry has steps faster than {ROBOT.fastest_mps:g} m/s, which count as no '
                'motion, though places keep their poses; check its unit, its source and its resets'
            )
        if self.resets:
            lines.append(
                'the stamps of images went back by more than a second: the robot may be anywhere, '
                'and what follows is a drive of its own'
            )
        return lines

    @property
    def resets(self) -> int:
        """Number of times that a clock jumped back."""
        return max(recognizer.resets for recognizer in self.each)

    def _each_said(self, line_of: Callable[[PlaceRecognizer], str]) -> list[str]:
        """Return the lines of recognisers, with the names of several cameras."""
        named = self.recognizers if len(self.recognizers) > 1 else {'': self.first}
        said = ((name, line_of(recognizer)) for name, recognizer in named.items())
        return [f'{name}: {line}' if name else line for name, line in said if line]

    def configure(self, config: Config) -> None:
        """Use other settings from now on."""
        # Settings that the map and its model require do not change.
        self.config = config = replace(config, encoding=self.config.encoding)
        for number, recognizer in enumerate(self.each):
            recognizer.configure(of_camera(config, number))
        self._set_usual_mount()

    def _set_usual_mount(self) -> None:
        if len(self.recognizers) > 1:
            x, y, z, *turn = self.config.robot.of_camera(0).mount
            self.first.reference_map.assume_mount(of_roll_pitch_yaw((x, y, z), *turn))

    def expect(self, estimate: PoseEstimate) -> int:
        """Look first near a pose, as `PlaceRecognizer.expect` does; return at how many places."""
        return max(recognizer.expect(estimate) for recognizer in self.each)

    def reset(self) -> None:
        """Forget the frames so far, as `PlaceRecognizer.reset` does."""
        for recognizer in self.each:
            recognizer.reset()


def of_camera(config: Config, number: int) -> Config:
    """Return the settings for a camera, by its number."""
    return replace(config, robot=config.robot.of_camera(number))
