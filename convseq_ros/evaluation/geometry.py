# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What geometry says of answers, for the report: inliers of the fields, and relative poses."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match, Pose
import numpy as np
import numpy.typing as npt

# (n, 4): row and column of an inlier in the query, then in the reference; 255 is the whole image.
Dots = npt.NDArray[np.uint8]
NO_DOTS: Dots = np.zeros((0, 4), np.uint8)


class Geometry:
    """
    Adds to the answers of a recogniser; decides nothing.

    Parameters
    ----------
    recognizer : PlaceRecognizer
        Whose newest answer is looked at.
    posed_map : ReferenceMap or None
        The same places with poses. The recogniser's own have none, so that no answer depends on
        odometry that images of a data set do not have.

    """

    def __init__(self, recognizer: PlaceRecognizer, posed_map: ReferenceMap | None) -> None:
        self._recognizer = recognizer
        reading = recognizer.config.reading
        self._poses = posed_map and RelativePoses(posed_map, recognizer.matcher, reading)

    def add(self, match: Match, frame: Frame) -> tuple[Match, Dots]:
        """Return the newest answer with its relative pose, if there is one, and the inliers."""
        buffer, config = self._recognizer.buffer, self._recognizer.config
        if match.best is None:
            return match, NO_DOTS
        features, accepted = buffer.newest.features, match.accepted
        if self._poses and features and accepted:
            seen = upright(frame, self._recognizer.reference_map.encoding, config.robot)
            pose = self._poses.measure(features, seen, accepted)
            match = replace(match, relative_pose=pose)
        return match, inliers(buffer.field(match.best))


def inliers(field: npt.NDArray[np.float64]) -> Dots:
    """Return the inliers of a field (n, 5), as `QueryBuffer.field` gives it."""
    shares = field[field[:, 4] > 0, :4]
    return (shares * 255).round().clip(0, 255).astype(np.uint8)


def pose_rows(poses: Sequence[Pose | None]) -> npt.NDArray[np.float64]:
    """Return positions and quaternions, (N, 7); NaN where they are not known."""
    unknown = (np.nan,) * 7
    return np.array([(*one.position, *one.orientation) if one else unknown for one in poses])
