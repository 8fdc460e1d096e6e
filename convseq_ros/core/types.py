# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The records that pass between stages; all frozen. Times are integer nanoseconds."""

from dataclasses import dataclass
from enum import StrEnum
import math
from typing import Any

import numpy as np
import numpy.typing as npt

Shift = tuple[float, float]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w; of unit length
# Arrays; their shapes are told where they are used.
Gray = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
Halves = npt.NDArray[np.float16]
Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Row = npt.NDArray[np.float32]  # (R,), scores of a frame; NaN where there is none


def constants(record: type[Any]) -> Any:
    """
    Return the one instance, frozen, of a class of annotated defaults: a stage's constants.

    What follows from other constants has no annotation.
    """
    made: Any = dataclass(frozen=True, slots=True)(record)
    return made()


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot's base, or a part of it, was: x ahead, y left, z up (REP-103)."""

    position: Vector  # x, y, z in metres
    orientation: Quaternion


# How many coefficients OpenCV takes, by the names of sensor_msgs/distortion_models.hpp.
COEFFICIENTS = {
    'plumb_bob': (4, 5), 'rational_polynomial': (8, 12, 14), 'equidistant': (4,),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera as sensor_msgs/CameraInfo gives it: size, focal lengths, centre, distortion."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion_model: str = ''  # of `COEFFICIENTS`; empty for none
    distortion: tuple[float, ...] = ()  # its coefficients, in OpenCV's order; none for none
    mount: Pose | None = None  # in the base, x along the lens; None if it is not known


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a stream."""

    stamp_ns: int  # when it was taken
    gray: npt.NDArray[np.uint8] | None  # (H, W); None if the image could not be decoded
    source: str = ''  # a file name or a topic
    pose: Pose | None = None  # where the robot's base was, if known
    problem: str = ''  # why the image could not be decoded, in one line
    camera: Camera | None = None  # what took it, if known
    # (h, w), metres along the lens, registered to the image; what is no depth is unknown.
    depth_m: npt.NDArray[np.float32] | None = None
    color: npt.NDArray[np.uint8] | None = None  # (H, W, 3), blue, green, red, if it was kept


@dataclass(frozen=True, eq=False, slots=True)
class Descriptor:
    """What is kept of one image; equal to itself only."""

    cells: npt.NDArray[np.float32]  # (S, S, 8), a histogram of gradient orientation each
    salient: npt.NDArray[np.bool_]  # ((S - 1) ** 2,), 2 x 2-cell regions that are informative
    cell_entropy: npt.NDArray[np.float64]  # (S, S), mean entropy in bits
    entropy: float  # mean of the image as a share of 8 bits, in [0, 1]
    vector: npt.NDArray[np.float16] | None = None  # (n,), of unit length, by a model

    @property
    def informative(self) -> bool:
        """False for a frame without gradient or without a salient region."""
        return bool(self.salient.any()) and bool(self.cells.any())


class Status(StrEnum):
    """What came of a frame."""

    ACCEPTED = 'accepted'
    REJECTED = 'rejected'
    SKIPPED = 'skipped'


class Reason(StrEnum):
    """Why; one for every frame."""

    ACCEPTED = 'accepted'
    AMBIGUOUS = 'ambiguous'
    WEAK = 'weak'
    TOO_FEW_RIVALS = 'too_few_rivals'
    IMPLAUSIBLE = 'implausible'
    COOL_DOWN = 'cool_down'
    RECENT = 'recent'
    STATIONARY = 'stationary'
    BETWEEN_KEYFRAMES = 'between_keyframes'
    WARMING_UP = 'warming_up'
    UNINFORMATIVE = 'uninformative'
    UNREADABLE = 'unreadable'
    OUT_OF_ORDER = 'out_of_order'
    NO_MAP = 'no_map'
    MAP_TOO_SHORT = 'map_too_short'


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place of the map that the newest frame of the sequence may show."""

    reference_index: int  # in the map, from 0
    reference_stamp_ns: int  # when the place was taken
    score: float  # of the sequence, in [0, 1]
    shift: Shift | None = None  # rows and columns, in cells, from query to reference, if known
    inliers: int | None = None  # regions that moved alike from query to reference, if verified
    session: int = 0  # of those of the map, the one that took the place


Candidates = tuple[Candidate, ...]  # best first


@dataclass(frozen=True, eq=False, slots=True)
class RelativePose:
    """
    Where the query's base was in the reference's base frame: x ahead, y left, z up.

    Equal to itself only. The rotation is always known. Where nothing gives the scale, `position_m`
    is None; where there is no baseline either, so is `direction`. Rows and columns of the
    covariance whose position is unknown hold a variance of `UNKNOWN_M2`.
    """

    orientation: Quaternion
    position_m: Vector | None
    direction: Vector | None  # of the position, a unit vector
    covariance: npt.NDArray[np.float64]  # (6, 6), of x, y, z and turns about them; m and rad
    inliers: int  # correspondences that agree with it
    explains: bool = True  # enough of what the images have in common

    @property
    def pose(self) -> Pose | None:
        """Where the query's base was, if the position is known."""
        return None if self.position_m is None else Pose(self.position_m, self.orientation)

    @property
    def position_sigma_m(self) -> float | None:
        """Standard deviation of the position in its least sure direction, if it is known."""
        if self.position_m is None:
            return None
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def heading_sigma_rad(self) -> float:
        """Standard deviation of the turn about z."""
        return math.sqrt(float(self.covariance[5, 5]))


UNKNOWN_M2 = 1e6  # variance of a position that is not known, in square metres


class LocalizationState(StrEnum):
    """Whether it is known where in the map the robot is."""

    LOST = 'lost'
    CANDIDATE = 'candidate'
    LOCALISED = 'localised'


@dataclass(frozen=True, slots=True)
class Localization:
    """Where in the map the robot is, as far as the frames so far tell."""

    state: LocalizationState = LocalizationState.LOST
    # Probability in [0, 1] that the place is right; 0 if lost, None if it is not calibrated.
    quality: float | None = 0.0
    reference_index: int | None = None  # the place that was recognised last; None if lost
    problem: str = ''  # why it is not localised, in one line


@dataclass(frozen=True, slots=True)
class Anchor:
    """The first look of a place, by what stays as the map grows, and as looks of it go."""

    session_id: str
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Match:
    """The answer to one frame."""

    query_index: int  # frames processed before this one
    query_stamp_ns: int
    status: Status
    reason: Reason
    candidates: Candidates = ()  # best first; empty if the frame was skipped
    sequence_length: int = 0  # frames matched together, k in the paper; 0 if none could be chosen
    pairs_scored: int = 0  # image pairs compared for this frame
    confidence: float | None = None  # probability in [0, 1] that the best is right, if calibrated
    # The best candidate's shift in pixels of the query image: rows, columns. Positive columns:
    # what the query shows is further right in the reference.
    shift_px: Shift | None = None
    # By how much the query's base is turned against the reference's, counter-clockwise seen from
    # above (REP-103), if the shift and the camera are known. Where both cameras are mounted alike,
    # one turned left, positive, sees things further right: negative columns.
    relative_yaw_rad: float | None = None
    # Of the base, against the accepted reference's; None if it was not measured.
    relative_pose: RelativePose | None = None
    anchor: Anchor | None = None  # of the accepted reference
    # By how many metres more than odometry may have drifted the place lies off, if it does.
    implausible_m: float | None = None
    localization: Localization | None = None  # after this frame; None if nobody kept it
    camera: str = ''  # the source of the frame, of a robot with several cameras

    @property
    def best(self) -> Candidate | None:
        """The best candidate, accepted or not."""
        return self.candidates[0] if self.candidates else None

    @property
    def accepted(self) -> Candidate | None:
        """The best candidate if it was accepted."""
        return self.best if self.status is Status.ACCEPTED else None
