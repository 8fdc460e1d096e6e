# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn street, whose poses are exact, and what is measured on it."""

from functools import cache
import math

from convseq_ros.config import Config
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.rigid import angle, inverse, matrix
from convseq_ros.core.similarity.matcher import make_matcher
from convseq_ros.core.types import Candidate, Pose
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.street import Street
from drives import shots_of

SIZE = {'width_px': 320, 'height_px': 240}


@cache
def drawn_street():
    """Return frames of a map, a metre apart, and of a drive in the evening, further left."""
    street = Street(120.0, 5)
    there = Drive(num_frames=30, **SIZE)
    here = Drive(num_frames=24, start_m=2.4, lane_offset_m=-0.7, light='evening', seed=1, **SIZE)
    return [[shot.frame for shot in shots_of(street, one)] for one in (there, here)]


def measured(reference_map, query, index, reading=ReadingConfig()):
    """Return the pose of a query against a place of a map."""
    matcher = make_matcher(reference_map, Config())
    features = matcher.extract(describe(query.gray, reference_map.encoding))
    found = Candidate(index, 0, 1.0, matcher.shift(features, index))
    return RelativePoses(reference_map, matcher, reading).measure(features, query, found)


def off(pose, query, place):
    """Return by how many metres and radians a pose is off."""
    truth = inverse(matrix(place.pose)) @ matrix(query.pose)
    said = matrix(Pose(pose.position_m, pose.orientation))
    return math.dist(said[:3, 3], truth[:3, 3]), angle(said[:3, :3] @ truth[:3, :3].T)
