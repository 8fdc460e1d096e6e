# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter, written once: name, default, bounds, unit and one sentence.

ROS declarations, the YAML file, command-line options and the table in the README are derived
from the dataclasses below. Names are unique across groups, so that users write them flat.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from convseq_ros.errors import ConfigError
from convseq_ros.parameter import Checked, Parameter, parameter, parameters, refuse_unknown, Value

Group = TypeVar('Group')


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class EncodingConfig(Checked):
    """How an image becomes cells, salient regions and an entropy (paper III-B, III-C)."""

    image_size_px: int = parameter(
        512, 'Side of the square that every image is resized to; W1 = H1 in the paper.',
        unit='px', low=64, high=2048,
    )
    saliency_threshold: float = parameter(
        0.5, 'Regions whose mean entropy is at least this share of 8 bits are salient; '
        'ET in the paper.', low=0.0, high=1.0,
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.image_size_px % 16:
            raise ConfigError(
                f'image_size_px: {self.image_size_px} is not a multiple of the 16 px cell'
            )


@dataclass(frozen=True, slots=True)
class MatchingConfig(Checked):
    """How a pair of images is scored, and which pairs are."""

    matching: str = parameter(
        'coherent', 'coherent asks where salient regions went, regional (the paper) how similar '
        'their best counterparts are.', choices=('coherent', 'regional'),
    )
    search: str = parameter(
        'shortlist', 'exhaustive scores every reference (the paper), shortlist the likely ones.',
        choices=('exhaustive', 'shortlist'),
    )
    remove_layout: bool = parameter(
        True, 'Compare evened cells less what is usual, and whole images; coherent matching only.'
    )
    shortlist_length: int = parameter(
        50, 'References at which the likely sequences may end.',
        unit='references', low=3, high=1000,
    )
    speed_search: bool = parameter(
        True, 'Follow a drive at half to twice the speed of the map, and over frames that went '
        'missing by their stamps; with coherent matching only.',
    )
    kernel: str = parameter(
        'auto', 'What computes pair scores: int8 and float32 are compiled (numba), numpy is not; '
        'auto takes the fastest that the machine has.',
        choices=('auto', 'int8', 'float32', 'numpy'),
    )
    threads: int = parameter(
        0, 'Threads that score pairs; 0 takes as many cores as the process may use, at most 2.',
        low=0, high=256,
    )


@dataclass(frozen=True, slots=True)
class SequenceConfig(Checked):
    """How many frames are matched together (paper III-A, E, F)."""

    fixed_length: int = parameter(
        0, 'Match this many frames always; 0 chooses the length for every frame.',
        unit='frames', low=0, high=100, dynamic=True,
    )
    overlap_threshold: float = parameter(
        0.9, 'The sequence grows while frames are at least this similar to its newest; '
        'IT in the paper.', low=0.0, high=1.0, dynamic=True,
    )
    entropy_threshold: float = parameter(
        0.5, 'The sequence grows while its mean image entropy is at most this; ET in the paper.',
        low=0.0, high=1.0, dynamic=True,
    )
    min_length: int = parameter(
        2, 'Shortest chosen sequence.', unit='frames', low=1, high=100,
    )
    max_overlap_length: int = parameter(
        15, 'Similarity alone grows the sequence no further than this.',
        unit='frames', low=1, high=100,
    )
    max_length: int = parameter(
        25, 'Longest chosen sequence.', unit='frames', low=1, high=100,
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
        'auto', 'track sums up the last frames, margin looks at the newest sequence alone; auto: '
        'track with coherent matching, margin with regional.',
        choices=('auto', 'margin', 'track'),
    )
    min_evidence: float = parameter(
        1.7, 'By the track rule, the last 30 frames must on average stand out by this many times '
        'the scatter of other places.', low=0.0, high=1000.0, dynamic=True,
    )
    min_margin: float = parameter(
        0.003, 'By the margin rule, a match must score this much more than its best rival.',
        low=0.0, high=1.0, dynamic=True,
    )
    rival_distance: int = parameter(
        10, 'References further than this from the best one are its rivals.',
        unit='references', low=0, high=10000, dynamic=True,
    )
    num_candidates: int = parameter(
        5, 'Candidates listed with every result, no two nearer than rival_distance.',
        low=1, high=100,
    )
    closure_interval_s: float = parameter(
        0.0, 'Least time between two accepted matches; what would be one in between is in '
        'cool_down. 0 accepts every frame that is sure.',
        unit='s', low=0.0, high=3600.0, dynamic=True,
    )


@dataclass(frozen=True, slots=True)
class MotionConfig(Checked):
    """When a robot stands still: such frames say nothing new and are passed over."""

    stationary_overlap: float = parameter(
        0.985, 'A frame more similar than this to the last that moved shows a robot that stands '
        'still; 1 asks no image. With coherent matching only, and without odometry.',
        low=0.0, high=1.0,
    )
    stationary_m: float = parameter(
        0.05, 'By odometry, a robot that is less far than this from the last frame that moved, '
        'and turned by less than a twentieth of a turn, stands still; 0 asks no odometry.',
        unit='m', low=0.0, high=100.0,
    )


@dataclass(frozen=True, slots=True)
class OnlineConfig(Checked):
    """Whether the map grows from the robot's own past, and how much of that is too fresh."""

    mode: str = parameter(
        'preloaded', 'preloaded recognises the places of a map, online also adds to it what the '
        'camera sees.', choices=('preloaded', 'online'),
    )
    exclusion_s: float = parameter(
        30.0, 'In online mode, places of this session younger than this are recent and not '
        'matched.', unit='s', low=0.0, high=86400.0,
    )
    exclusion_m: float = parameter(
        0.0, 'In online mode with odometry, places of this session that were passed less than '
        'this distance ago are recent and not matched.', unit='m', low=0.0, high=100000.0,
    )


@dataclass(frozen=True, slots=True)
class KeyframeConfig(Checked):
    """
    Which frames become references, of a map that is built or that grows.

    The queries matched with a map are as far apart: of a map that was opened it is known how.
    """

    keyframe_interval_s: float = parameter(
        0.0, 'Least time between two keyframes, of which a camera may be a tenth early.',
        unit='s', low=0.0, high=3600.0,
    )
    keyframe_distance_m: float = parameter(
        0.0, 'With odometry, least way between two keyframes, unless the robot turns by a '
        'twentieth of a turn.', unit='m', low=0.0, high=1000.0,
    )
    keyframe_overlap: float = parameter(
        0.75, 'A frame of which a larger share than this moved together since the last keyframe '
        'is passed over; 1 takes every frame, as the paper does.', low=0.0, high=1.0,
    )
    thumbnail_width_px: int = parameter(
        128, 'Width of the small pictures kept in the map for people to look at; 0 keeps none.',
        unit='px', low=0, high=640,
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
    online: OnlineConfig = OnlineConfig()
    keyframes: KeyframeConfig = KeyframeConfig()


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
    """
    Return a configuration from flat names.

    Raises
    ------
    ConfigError
        If a name is unknown or a value is not allowed.

    """
    refuse_unknown(values, [item.name for item in core_parameters()])
    return Config(**{name: make_group(kind, values) for name, kind in _groups(Config).items()})


def flatten(config: Config) -> dict[str, Value]:
    """Return all values of a configuration under their flat names."""
    return {
        item.name: getattr(getattr(config, name), item.name)
        for name, kind in _groups(Config).items()
        for item in parameters(kind)
    }
