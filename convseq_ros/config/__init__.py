# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: name, default, bounds, unit and one sentence, each written once."""

from convseq_ros.config.acceptance_config import AcceptanceConfig
from convseq_ros.config.config import (
    Config,
    core_parameters,
    EncodingConfig,
    EVERY_FRAME,
    flatten,
    KeyframeConfig,
    make_config,
    make_group,
    MatchingConfig,
    MotionConfig,
    OnlineConfig,
    with_values,
)
from convseq_ros.config.robot_config import RobotConfig
from convseq_ros.config.sequence_config import SequenceConfig

__all__ = [
    'EVERY_FRAME',
    'AcceptanceConfig',
    'Config',
    'EncodingConfig',
    'KeyframeConfig',
    'MatchingConfig',
    'MotionConfig',
    'OnlineConfig',
    'RobotConfig',
    'SequenceConfig',
    'core_parameters',
    'flatten',
    'make_config',
    'make_group',
    'with_values',
]
