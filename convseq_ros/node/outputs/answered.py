# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A frame and its answer."""

from dataclasses import dataclass

from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match


@dataclass(frozen=True, eq=False, slots=True)
class Answered:
    """A frame and its answer."""

    frame: Frame
    match: Match
    recognizer: PlaceRecognizer  # that made it; for its map, and what a picture of it shows
    session_start: int  # places of the map from this index on are of the running drive
    model_ms: float  # of the work: that of the descriptor model
    duration_ms: float  # of the work
    latency_ms: float  # since the image arrived
