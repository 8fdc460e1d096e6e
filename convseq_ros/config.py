# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter, written once: name, default, bounds, unit and one sentence.

ROS declarations, the YAML file, command-line options and docs/PARAMETERS.md are derived from the
dataclasses below. Names are unique across groups, so that users write them flat.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from convseq_ros.errors import ConfigError
from convseq_ros.online_config import OnlineConfig
from convseq_ros.parameter import Checked, Parameter, parameter, parameters, refuse_unknown, Value
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.robot_config import RobotConfig

Group = TypeVar('Group')


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class EncodingConfig(Checked):
    """How an image becomes cells, salient regions and an entropy (paper III-B, III-C)."""

    image_size_px: int = parameter(
        512, 'Side of the square to which every image is resized; W1 = H1 in the paper.',
        unit='px', low=64, high=2048,
    )
    saliency_threshold: float = parameter(
        0.5, 'A region of an image is salient, and compared, if its mean entropy is at least this '
        'share of 8 bits; ET in the paper.', low=0.0, high=1.0,
    )
    resize: str = parameter(
        'exact', 'How images are resized: exact is the same on every processor, linear as in maps '
        'that were made before; a map keeps its own.', choices=('exact', 'linear'),
    )
    image_mask: str = parameter(
        '', 'Picture file: white where the camera sees the world, black where it sees the robot '
        'or nothing; of any size; empty for none, or the one that a map keeps.',
    )
    image_rotation_deg: int = parameter(
        0, 'Images are turned counter-clockwise by this before all else, for a camera on its '
        'side or upside down: 0, 90, 180 or 270.', unit='deg', low=0, high=270,
    )
    descriptor_model: str = parameter(
        '', 'ONNX file of a network that turns an image into the vector by which places are found '
        'first; empty for the built-in one. A map is of one model.',
    )
    keeps_cells: bool = True  # in maps; with `matching: descriptor` they are not needed

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        for name, step in (('image_size_px', 16), ('image_rotation_deg', 90)):
            if (value := getattr(self, name)) % step:
                raise ConfigError(f'{name}: {value} is not a multiple of {step}')


@dataclass(frozen=True, slots=True)
class MatchingConfig(Checked):
    """How a pair of images is scored, and which pairs are."""

    matching: str = parameter(
        'coherent', 'Pair score of two images: regional is the mean similarity of best matching '
        'regions (the paper), coherent the share of regions that moved together, descriptor the '
        'cosine of two descriptors, without geometry.',
        choices=('coherent', 'regional', 'descriptor'),
    )
    search: str = parameter(
        'shortlist', 'Which map places get a pair score: exhaustive scores all of them (the '
        'paper), shortlist those that global descriptors make likely.',
        choices=('exhaustive', 'shortlist'),
    )
    subtract_background: bool = parameter(
        True, 'Coherent matching compares normalised cells less the average image of the map and '
        'of the drive, and weighs in the global similarity.',
    )
    shortlist_length: int = parameter(
        40, 'Number of map places that get a pair score per frame because the drive so far makes '
        'them likely; a quarter more are likely by the newest frame. Shortlist only.',
        unit='places', low=3, high=1000,
    )
    both_directions: bool = parameter(
        False, 'A drive may also meet the places of the map in reverse order: in reverse gear, or '
        'with a rear camera on the way back.',
    )
    kernel: str = parameter(
        'auto', 'Implementation of pair scores: int8 and float32 are compiled C, numpy is not; '
        'auto takes the fastest that this machine has.',
        choices=('auto', 'int8', 'float32', 'numpy'),
    )
    threads: int = parameter(
        0, 'Threads that compute pair scores; 0 takes as many cores as the process may use, at '
        'most 2.', low=0, high=256,
    )


@dataclass(frozen=True, slots=True)
class SequenceConfig(Checked):
    """How many frames are matched together (paper III-A, E, F)."""

    fixed_length: int = parameter(
        0, 'Frames in every sequence; 0 chooses the length for each frame, as the paper does.',
        unit='frames', low=0, high=100, dynamic=True,
    )
    overlap_threshold: float = parameter(
        0.9, 'A sequence grows while its oldest frame is at least this similar to the newest; IT '
        'in the paper.', low=0.0, high=1.0, dynamic=True,
    )
    entropy_threshold: float = parameter(
        0.5, 'A sequence grows while the mean entropy of its images, as a share of 8 bits, is at '
        'most this; ET in the paper.', low=0.0, high=1.0, dynamic=True,
    )
    min_length: int = parameter(
        2, 'Shortest sequence that is chosen.', unit='frames', low=1, high=100,
    )
    max_overlap_length: int = parameter(
        15, 'Longest sequence that similarity alone can make.', unit='frames', low=1, high=100,
    )
    max_length: int = parameter(
        25, 'Longest sequence that is chosen.', unit='frames', low=1, high=100,
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if not self.min_length <= self.max_overlap_length <= self.max_length:
            raise ConfigError(
                f'min_length, max_overlap_length, max_length: {self.min_length}, '
                f'{self.max_overlap_length}, {self.max_length} are not in ascending order'
            )

    @property
    def window(self) -> int:
        """The most frames that a sequence can need."""
        return self.fixed_length or self.max_length


@dataclass(frozen=True, slots=True)
class AcceptanceConfig(Checked):
    """When the best candidate is published as a match."""

    acceptance_rule: str = parameter(
        'auto', 'How a match is accepted: belief accepts a place that is nearly sure after all '
        'frames so far, margin a sequence that scores more than its best rival (the paper has no '
        'such rule); auto is belief with coherent matching, margin with regional.',
        choices=('auto', 'belief', 'margin'),
    )
    min_confidence: float = parameter(
        0.9, 'Belief: a match is accepted if the probability that it is right is at least this. '
        'Lower is bolder, higher is safer.', low=0.0, high=1.0, dynamic=True,
    )
    min_margin: float = parameter(
        0.003, 'Margin rule: a match is accepted if it scores this much more than its best rival.',
        low=0.0, high=1.0, dynamic=True,
    )
    rival_distance: int = parameter(
        10, 'Map places further than this from a candidate are other places: its rivals.',
        unit='places', low=0, high=10000, dynamic=True,
    )
    num_candidates: int = parameter(
        5, 'Candidates in every result, no two nearer than rival_distance.', low=1, high=100,
    )
    closure_interval_s: float = parameter(
        0.0, 'Least time between two accepted matches; 0 accepts every sure frame.',
        unit='s', low=0.0, high=3600.0, dynamic=True,
    )


@dataclass(frozen=True, slots=True)
class MotionConfig(Checked):
    """When a robot stands still: such frames say nothing new and are passed over."""

    stationary_overlap: float = parameter(
        0.985, 'Without odometry, the robot stands still while frames are more similar than this '
        'to the last that moved; 1 never says so. Not with the margin rule.', low=0.0, high=1.0,
    )
    stationary_m: float = parameter(
        0.05, 'With odometry, the robot stands still while it is nearer than this to the last '
        'frame that moved, and turned by less than 18 degrees; 0 never says so.',
        unit='m', low=0.0, high=100.0,
    )


@dataclass(frozen=True, slots=True)
class KeyframeConfig(Checked):
    """
    Which frames become places, of a map that is built or that grows.

    Frames that are matched with a map are as far apart: a map that is opened says how far.
    """

    keyframe_interval_s: float = parameter(
        0.0, 'Least time between two keyframes; a camera may be a tenth early.',
        unit='s', low=0.0, high=3600.0,
    )
    keyframe_distance_m: float = parameter(
        0.0, 'With odometry, least way between two keyframes, unless the robot turns by 18 '
        'degrees.', unit='m', low=0.0, high=1000.0,
    )
    keyframe_overlap: float = parameter(
        0.75, 'A frame is no keyframe if a larger share of its regions than this moved together '
        'since the last one; 1 takes every frame, as the paper does.', low=0.0, high=1.0,
    )
    thumbnail_width_px: int = parameter(
        128, 'Width of the small pictures that a map keeps for people to look at; 0 keeps none.',
        unit='px', low=0, high=640,
    )
    keep_images_px: int = parameter(
        0, 'Longer side of the images that a map keeps, as JPEGs, so that by day keypoints tell '
        'more exactly where a camera was; 320 takes 8 to 16 kB a place; 0 keeps none.',
        unit='px', low=0, high=1280,
    )

    @property
    def spacing(self) -> dict[str, float]:
        """What decides how far apart keyframes are, by name."""
        return {
            'keyframe_interval_s': self.keyframe_interval_s,
            'keyframe_distance_m': self.keyframe_distance_m,
            'keyframe_overlap': self.keyframe_overlap,
        }


# fmt: on
EVERY_FRAME = KeyframeConfig(keyframe_overlap=1.0)


@dataclass(frozen=True, slots=True)
class Config:
    """Everything that decides a match: the same online and offline."""

    encoding: EncodingConfig = EncodingConfig()
    matching: MatchingConfig = MatchingConfig()
    sequence: SequenceConfig = SequenceConfig()
    acceptance: AcceptanceConfig = AcceptanceConfig()
    motion: MotionConfig = MotionConfig()
    robot: RobotConfig = RobotConfig()
    online: OnlineConfig = OnlineConfig()
    keyframes: KeyframeConfig = KeyframeConfig()
    reading: ReadingConfig = ReadingConfig()

    def __post_init__(self) -> None:
        if self.acceptance.acceptance_rule == 'belief' and self.matching.matching != 'coherent':
            raise ConfigError(
                f'acceptance_rule: belief needs matching: coherent, not {self.matching.matching}'
            )

    @property
    def believes(self) -> bool:
        """Whether the belief decides, not the margin of the newest sequence."""
        rule, matching = self.acceptance.acceptance_rule, self.matching.matching
        return rule == 'belief' or (rule == 'auto' and matching == 'coherent')


def _groups(kind: type) -> dict[str, type]:
    return {item.name: item.type for item in fields(kind)}  # type: ignore[misc]


def core_parameters() -> Iterator[Parameter]:
    """Yield the parameters of `Config`, all groups, in order."""
    for group in _groups(Config).values():
        yield from parameters(group)


def make_group(kind: type[Group], values: Mapping[str, Any]) -> Group:
    """Return a group with the values that are its own; others are left to their groups."""
    names = {item.name for item in parameters(kind)}
    return kind(**{name: value for name, value in values.items() if name in names})


def make_config(values: Mapping[str, Any]) -> Config:
    """Return a configuration from flat names; ConfigError if a name or value is not allowed."""
    refuse_unknown(values, [item.name for item in core_parameters()])
    return Config(**{name: make_group(kind, values) for name, kind in _groups(Config).items()})


def flatten(config: Config) -> dict[str, Value]:
    """Return all values of a configuration under their flat names."""
    return {
        item.name: getattr(getattr(config, name), item.name)
        for name, kind in _groups(Config).items()
        for item in parameters(kind)
    }
