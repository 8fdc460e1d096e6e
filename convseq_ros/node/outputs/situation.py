# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The state of the node, besides its counters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from convseq_ros.app.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Situation:
    """What others are told of the node, besides its counters."""

    ready: bool  # False while it warms up
    enabled: bool  # False if frames are ignored on purpose
    pipeline: Pipeline  # the map in use and its file
    topic: str  # of the camera
    dropped: int  # frames pushed out of the queue
    odometry_comes: bool
    silences: Callable[[], Mapping[str, str]]  # why nothing comes on a topic; empty if it does
    further: Mapping[str, int | bool | float]  # other values on /diagnostics, by name
    transform_problem: str = ''  # why map -> odom is not broadcast, although it is wanted
    model_problem: str = ''  # why the map's descriptor_model is not used, if it failed
    stamp_problem: str = ''  # of the images

    @property
    def map_size(self) -> int:
        return len(self.pipeline.recognizer.reference_map)
