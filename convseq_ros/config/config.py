# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter, written once: name, default, bounds, unit and one sentence.

ROS declarations, the YAML file, command-line options and docs/PARAMETERS.md are derived from the
dataclasses below. Names are unique across groups, so that users write them flat.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from convseq_ros.config.acceptance_config import AcceptanceConfig
from convseq_ros.config.parameter import (
    Checked,
    Parameter,
    parameter,
    parameters,
    refuse_unknown,
    Value,
)
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.config.robot_config import RobotConfig
from convseq_ros.config.sequence_config import SequenceConfig
from convseq_ros.errors import ConfigError

MOST_KEYPOINTS = 1000  # of a place; more in a file of a map are damage

Group = TypeVar('Group')


# A table of parameters reads better in few lines. Fields without text are constants: nobody can
# choose them from knowledge of a robot, but studies vary them in Python.
# fmt: off
@dataclass(frozen=True, slots=True)
class EncodingConfig(Checked):
    """How an image becomes cells, salient regions and an entropy (paper III-B, III-C)."""

    image_size_px: int = parameter(
        512, 'Sides of the square to which images are resized.',
        unit='px', low=64, high=2048,
    )
    saliency_threshold: float = parameter(
        0.5, 'Least mean entropy of a salient region, as a fraction of 8 bits; ET in the paper.',
        low=0.0, high=1.0,
    )
    resize: str = parameter(
        'exact', 'exact is the same on every processor, linear is as in the paper; all of a map '
        'needs the same.', choices=('exact', 'linear'),
    )
    image_mask: str = parameter(
        '', 'Picture that is black where images show the robot; empty uses that of the map.',
        is_path=True,
    )
    image_rotation_deg: int = parameter(
        0, 'Counter-clockwise rotation of images: 0, 90, 180 or 270.', unit='deg', low=0, high=270,
    )
    descriptor_model: str = parameter(
        '', 'ONNX file of the network that selects the places to compare, the same for all of a '
        'map; empty for the built-in descriptor.', is_path=True,
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        for name, step in (('image_size_px', 16), ('image_rotation_deg', 90)):
            if (value := getattr(self, name)) % step:
                raise ConfigError(f'{name}: {value} is not a multiple of {step}')


@dataclass(frozen=True, slots=True)
class MatchingConfig(Checked):
    """How a pair of images is scored, and which pairs are scored."""

    matching: str = parameter(
        'coherent', 'coherent counts regions that moved together, regional averages the best '
        'matching regions, as in the paper.',
        choices=('coherent', 'regional'),
    )
    search: str = parameter(
        'shortlist', 'shortlist compares the likely places, exhaustive all, as in the paper.',
        choices=('exhaustive', 'shortlist'),
    )
    shortlist_length: int = 40  # places by the drive so far; a quarter more by the newest frame
    both_directions: bool = parameter(
        False, 'Whether places are often passed in reverse order, as by a rear camera.',
    )
    threads: int = parameter(
        0, 'Threads that compare images; 0 uses at most two cores.',
        low=0, high=256,
    )


@dataclass(frozen=True, slots=True)
class MotionConfig(Checked):
    """When a robot stands still: its frames add no information and are left out."""

    # Without odometry, a robot stands still while glances (encoding.glance) are closer; 0: never.
    # Of 1,208 pairs with noise of 1 to 8 levels and by 5 to 100 % of the light, 47 % of
    # those that did not move are closer, 3 % that moved by a pixel of 640, and none by two.
    stationary_glance: float = 0.1
    stationary_m: float = parameter(
        0.05, 'With odometry, the robot stands until it has moved this far or turned by 18 '
        'degrees; 0 turns this off.',
        unit='m', low=0.0, high=100.0, dynamic=True,
    )


@dataclass(frozen=True, slots=True)
class OnlineConfig(Checked):
    """Whether the map grows while driving, and by how much."""

    mode: str = parameter(
        'preloaded', 'preloaded recognises places of a map, online also adds new ones.',
        choices=('preloaded', 'online'),
    )
    max_looks: int = parameter(
        8, 'Stretches of 16 keyframes that are kept of one place, online; 0 keeps all.',
        unit='stretches', low=0, high=100,
    )

    @property
    def grows(self) -> bool:
        """Whether the map grows."""
        return self.mode != 'preloaded'


@dataclass(frozen=True, slots=True)
class KeyframeConfig(Checked):
    """Which frames become places; frames to match are as far apart as the places of the map."""

    keyframe_interval_s: float = parameter(
        0.0, 'Least time between two keyframes.', unit='s', low=0.0, high=3600.0,
    )
    keyframe_distance_m: float = parameter(
        0.0, 'With odometry, least distance between two keyframes, or a turn of 18 degrees.',
        unit='m', low=0.0, high=1000.0,
    )
    keyframe_overlap: float = parameter(
        0.75, 'A frame becomes a keyframe when at most this fraction of its regions moved '
        'together since the last keyframe; 1 takes every frame, as in the paper.',
        low=0.0, high=1.0,
    )
    thumbnail_width_px: int = 128  # of the previews that a map stores; 0 stores none
    keypoints: int = parameter(
        300, 'Keypoints that the map keeps of each place, a second witness by day; 0 keeps none.',
        low=0, high=MOST_KEYPOINTS,
    )
    keep_images_px: int = parameter(
        0, 'Longer side of an image that the map keeps of each place, for better poses; 0 keeps '
        'none.', unit='px', low=0, high=1280,
    )

    @property
    def spacing(self) -> dict[str, float]:
        """The settings for the spacing of keyframes, by name."""
        return {
            'keyframe_interval_s': self.keyframe_interval_s,
            'keyframe_distance_m': self.keyframe_distance_m,
            'keyframe_overlap': self.keyframe_overlap,
        }


# fmt: on
EVERY_FRAME = KeyframeConfig(keyframe_overlap=1.0)


@dataclass(frozen=True, slots=True)
class Config:
    """All settings that affect a match; they are the same online and offline."""

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
        if self.sequence.sequence_regions == 'newest' and self.matching.matching != 'regional':
            raise ConfigError(
                f'sequence_regions: newest needs matching: regional, not {self.matching.matching}'
            )

    @property
    def believes(self) -> bool:
        """Whether the belief decides, not the margin of the newest sequence."""
        rule, matching = self.acceptance.acceptance_rule, self.matching.matching
        return rule == 'belief' or (rule == 'auto' and matching == 'coherent')


_GROUPS: dict[str, Any] = {item.name: item.type for item in fields(Config)}


def core_parameters() -> Iterator[Parameter]:
    """Yield the parameters of `Config`, all groups, in order."""
    for group in _GROUPS.values():
        yield from parameters(group)


def make_group(kind: type[Group], values: Mapping[str, Any]) -> Group:
    """Return a group with those of the values that belong to it; ignore the others."""
    names = {item.name for item in parameters(kind)}
    return kind(**{name: value for name, value in values.items() if name in names})


def make_config(values: Mapping[str, Any]) -> Config:
    """Return a configuration from flat names; ConfigError if a name or value is not allowed."""
    refuse_unknown(values, [item.name for item in core_parameters()])
    return with_values(Config(), values)


def with_values(config: Config, values: Mapping[str, Any]) -> Config:
    """Return a configuration with some values replaced, by flat name; constants are allowed."""
    changed = {}
    for name in _GROUPS:
        group = getattr(config, name)
        new = {item.name: values[item.name] for item in fields(group) if item.name in values}
        changed[name] = replace(group, **new)
    return replace(config, **changed)


def flatten(config: Config) -> dict[str, Value]:
    """Return all values of a configuration, also constants, by flat name."""
    groups = (getattr(config, name) for name in _GROUPS)
    return {item.name: getattr(group, item.name) for group in groups for item in fields(group)}
