# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The records that pass between stages; all frozen. Times are integer nanoseconds."""

from dataclasses import dataclass, field
from enum import StrEnum
import math
import operator
from typing import Any

import numpy as np
import numpy.typing as npt

Shift = tuple[float, float]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w; of unit length
# Arrays; their shapes are documented where they are used.
Gray = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
Halves = npt.NDArray[np.float16]
Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Row = npt.NDArray[np.float32]  # (R,), scores of a frame; NaN where there is none


def constants(record: type[Any]) -> Any:
    """
    Return the single, frozen instance of a class with annotated defaults: a stage's constants.

    A class attribute that is computed from other constants has no annotation.
    """
    frozen: Any = dataclass(frozen=True, slots=True)(record)
    return frozen()


@constants
class IMAGE:
    """What counts as the same view."""

    stretch: float = 0.02  # by which proportions may differ: rectified images lose a few pixels


@constants
class ROBOT:
    """What a robot can do."""

    fastest_mps: float = 40.0  # 144 km/h


def are_proportional(size: tuple[int, ...], image: tuple[int, ...]) -> bool:
    """Return whether a size, (h, w), may be that of an image, (H, W), on another scale."""
    aspect, wanted = size[1] / size[0], image[1] / image[0]
    return abs(aspect - wanted) <= IMAGE.stretch * wanted


@dataclass(frozen=True, slots=True)
class Pose:
    """The pose of a robot's base, or of a part of it: x ahead, y left, z up (REP-103)."""

    position: Vector  # x, y, z in metres
    orientation: Quaternion
    # Of position (m2) and heading (rad2), 0 if not told, of odometry; None for any other pose.
    variances: tuple[float, float] | None = field(default=None, compare=False)

    @property
    def yaw_rad(self) -> float:
        """Turn about z, counter-clockwise."""
        x, y, z, w = self.orientation
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


# Valid numbers of coefficients in OpenCV, by the names of sensor_msgs/distortion_models.hpp.
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
    distortion: tuple[float, ...] = ()  # its coefficients, in OpenCV's order; empty for none
    mount: Pose | None = None  # in the base, x along the optical axis; None if unknown


def check_gray(image: Any) -> None:
    """Raise a ValueError if an image is not an array (H, W) of uint8."""
    is_array = isinstance(image, np.ndarray)
    if not is_array or image.ndim != 2 or image.dtype != np.uint8 or image.size == 0:
        got = f'{image.shape} {image.dtype}' if is_array else type(image).__name__
        raise ValueError(f'expected (H, W) uint8, got {got}')


@dataclass(frozen=True, slots=True)
class Frame:
    """
    One image of a stream.

    ValueError for a stamp that is no integer, or an image that is no array (H, W) of uint8.
    """

    stamp_ns: int  # time of the image
    gray: npt.NDArray[np.uint8] | None  # (H, W); None if the image could not be decoded
    source: str = ''  # a file name or a topic
    pose: Pose | None = None  # of the robot's base, by odometry
    problem: str = ''  # why the image could not be decoded, in one line
    camera: Camera | None = None  # None if unknown
    frame_id: str = ''  # name of the camera's coordinates, as the message has it

    def __post_init__(self) -> None:
        try:
            stamp_ns = int(operator.index(self.stamp_ns))
        except TypeError:
            raise ValueError(f'stamp_ns: {self.stamp_ns!r} is no integer; give ns') from None
        if not -(2**63) <= stamp_ns < 2**63:
            raise ValueError(f'stamp_ns: {stamp_ns} does not fit into 64 bits; give ns')
        object.__setattr__(self, 'stamp_ns', stamp_ns)
        if self.gray is not None:
            check_gray(self.gray)


@dataclass(frozen=True, eq=False, slots=True)
class Descriptor:
    """The description of an image; two descriptors are never equal."""

    cells: npt.NDArray[np.float32]  # (S, S, 8), a histogram of gradient orientations in each cell
    salient: npt.NDArray[np.bool_]  # ((S - 1) ** 2,), whether a region of 2 x 2 cells is salient
    cell_entropy: npt.NDArray[np.float64]  # (S, S), mean entropy in bits
    entropy: float  # mean entropy of the image as a share of 8 bits, in [0, 1]
    vector: npt.NDArray[np.float16] | None = None  # (n,), unit length, by a descriptor model
    # Of a frame without an image: keypoints (n, 34), as a map stores them, and brightness (32,).
    keypoints: npt.NDArray[np.uint8] | None = None
    brightness: npt.NDArray[np.float64] | None = None

    @property
    def informative(self) -> bool:
        """False for a frame without gradient or without a salient region."""
        return bool(self.salient.any()) and bool(self.cells.any())


class Status(StrEnum):
    """The outcome of a frame; it follows from the reason and the candidates."""

    ACCEPTED = 'accepted'
    REJECTED = 'rejected'
    SKIPPED = 'skipped'


class Reason(StrEnum):
    """Why a frame is a match, or none."""

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


# A frame in cool-down shows a place as surely as an accepted one; it is only not published.
RECOGNISED = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place of the map that the newest frame may show."""

    reference_index: int  # in the map, from 0
    reference_stamp_ns: int  # time of the place's image
    score: float  # of the sequence, in [0, 1]
    shift: Shift | None = None  # rows and columns, in cells, from query to reference, if known
    inliers: int | None = None  # regions with a consistent displacement, if verified
    session: int = 0  # index of the map's session to which the place belongs


Candidates = tuple[Candidate, ...]  # best first


@dataclass(frozen=True, eq=False, slots=True)
class RelativePose:
    """
    The base's pose at the query in its frame at the reference: x ahead, y left, z up.

    The rotation is always known. `position_m` is None if it is too unsure; its directions have a
    variance of `UNKNOWN_M2` then. Two poses are never equal.
    """

    orientation: Quaternion
    position_m: Vector | None
    direction: Vector | None  # of the position, a unit vector
    covariance: npt.NDArray[np.float64]  # (6, 6), of x, y, z, rotations about them; m and rad
    inliers: int  # correspondences that agree with the pose
    explains: bool = True  # whether the pose explains enough of the images' common part

    @property
    def pose(self) -> Pose | None:
        """The pose with its position; None if the position is unknown."""
        return None if self.position_m is None else Pose(self.position_m, self.orientation)

    @property
    def position_sigma_m(self) -> float | None:
        """Largest standard deviation of the position in any direction; None if unknown."""
        if self.position_m is None:
            return None
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def heading_sigma_rad(self) -> float:
        """Standard deviation of the rotation about z."""
        return math.sqrt(float(self.covariance[5, 5]))


UNKNOWN_M2 = 1e6  # variance of an unknown position, in square metres


@dataclass(frozen=True, eq=False, slots=True)
class PoseEstimate:
    """A pose and its uncertainty."""

    pose: Pose  # in the frame of the map
    # (6, 6), of x, y, z in metres and of turns about these axes in radians
    covariance: npt.NDArray[np.float64]

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same, so that matches can be compared."""
        if not isinstance(other, PoseEstimate):
            return NotImplemented
        return self.pose == other.pose and np.array_equal(self.covariance, other.covariance)

    def __hash__(self) -> int:
        return hash(self.pose)

    def __str__(self) -> str:
        """Return the estimate for people; its first sigma is the mean over x and y."""
        x, y, z = self.pose.position
        variance_m2 = float(self.covariance[:2, :2].trace()) / 2
        sigma_m, sigma_rad = (
            math.sqrt(max(0.0, each)) for each in (variance_m2, float(self.covariance[5, 5]))
        )
        return (
            f'x {x:.2f} y {y:.2f} z {z:.2f} m (sigma {sigma_m:.2f}), '
            f'yaw {self.pose.yaw_rad:.3f} rad (sigma {sigma_rad:.3f})'
        )


class LocalizationState(StrEnum):
    """Whether the robot's place in the map is known."""

    LOST = 'lost'
    CANDIDATE = 'candidate'
    LOCALISED = 'localised'


@dataclass(frozen=True, slots=True)
class Localization:
    """The robot's place in the map, estimated from the frames so far."""

    state: LocalizationState = LocalizationState.LOST
    # Probability in [0, 1] that the place is right; 0 if lost, None if it is not calibrated.
    quality: float | None = 0.0
    reference_index: int | None = None  # the place that was recognised last; None if lost
    problem: str = ''  # why the robot is not localised, in one line


@dataclass(frozen=True, slots=True)
class Anchor:
    """The id of a place: its first look, which stays the same as looks are added or removed."""

    session_id: str
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Match:
    """The answer to one frame."""

    query_index: int  # frames processed before this one
    query_stamp_ns: int
    reason: Reason
    candidates: Candidates = ()  # best first; empty if the frame was skipped
    sequence_length: int = 0  # k: number of frames on which the answer rests; 0 without any
    pairs_scored: int = 0  # number of image pairs compared for this frame
    confidence: float | None = None  # probability in [0, 1] that the best is right, if calibrated
    # Shift of the best candidate in pixels of the query image: rows, columns. With positive
    # columns, objects are further right in the reference than in the query.
    shift_px: Shift | None = None
    # Yaw of the query's base relative to the reference's, counter-clockwise seen from above
    # (REP-103), if the shift and the camera are known. With equal mounts, a positive yaw (left)
    # moves objects to the right in the query: negative columns.
    relative_yaw_rad: float | None = None
    # Pose of the base relative to the best reference's; None if it was not measured. A match in
    # cool-down has it as well, for the map.
    relative_pose: RelativePose | None = None
    # Of the camera in the map, as if the map's poses were exact (`pose.estimate.with_map_errors`);
    # None if no reference is accepted, or if it has no pose.
    pose: PoseEstimate | None = None
    anchor: Anchor | None = None  # of the accepted reference
    # Distance of the best place from odometry, in metres beyond the possible drift, also if it is
    # accepted; None if plausible, or not asked.
    implausible_m: float | None = None
    localization: Localization | None = None  # after this frame; None if it was not computed
    camera: str = ''  # source of the frame, if the robot has several cameras
    # Share of the views of query and accepted reference that is common, in [0, 1]: near 1 from the
    # same viewpoint, below 0.5 the scene was seen from elsewhere; None if unknown.
    overlap: float | None = None

    @property
    def status(self) -> Status:
        """Whether the best candidate was accepted or rejected; skipped without candidates."""
        if self.reason is Reason.ACCEPTED:
            return Status.ACCEPTED
        return Status.REJECTED if self.candidates else Status.SKIPPED

    @property
    def best(self) -> Candidate | None:
        """The best candidate, accepted or not."""
        return self.candidates[0] if self.candidates else None

    @property
    def accepted(self) -> Candidate | None:
        """The best candidate if it was accepted."""
        return self.best if self.reason is Reason.ACCEPTED else None
