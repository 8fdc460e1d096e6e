# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The records that pass between stages; all frozen."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

Shift = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Pose:
    """
    Where a camera was.

    Parameters
    ----------
    position : tuple of 3 floats
        x, y, z in metres.
    orientation : tuple of 4 floats
        Unit quaternion x, y, z, w.

    """

    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Camera:
    """
    A pinhole camera, as sensor_msgs/CameraInfo gives it.

    Parameters
    ----------
    width_px, height_px : int
        Of its images.
    fx_px, fy_px, cx_px, cy_px : float
        Focal lengths and principal point.

    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


@dataclass(frozen=True, slots=True)
class Frame:
    """
    One image of a stream.

    Parameters
    ----------
    stamp_ns : int
        When it was taken, nanoseconds.
    gray : ndarray of uint8, shape (H, W), or None
        None if the image could not be decoded; `problem` then says why in one line.
    source : str
        Where it came from: a file name or a topic.
    pose : Pose, optional
        Where the camera was, if known.
    camera : Camera, optional
        What took it, if known.

    """

    stamp_ns: int
    gray: npt.NDArray[np.uint8] | None
    source: str = ''
    pose: Pose | None = None
    problem: str = ''
    camera: Camera | None = None


@dataclass(frozen=True, slots=True)
class Descriptor:
    """
    What is kept of one image.

    Parameters
    ----------
    cells : ndarray of float32, shape (rows, columns, bins)
        Histograms of gradient orientation, one a cell.
    salient : ndarray of bool, shape (regions,)
        Which 2 x 2-cell regions are informative, row by row.
    cell_entropy : ndarray of float64, shape (rows, columns)
        Mean entropy of each cell, in bits.
    entropy : float
        Mean entropy of the image as a share of 8 bits, in [0, 1].

    """

    cells: npt.NDArray[np.float32]
    salient: npt.NDArray[np.bool_]
    cell_entropy: npt.NDArray[np.float64]
    entropy: float

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
    INCONSISTENT = 'inconsistent'
    TOO_FEW_RIVALS = 'too_few_rivals'
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
    """
    A reference that the newest frame of the sequence may show.

    Parameters
    ----------
    reference_index : int
        Its place in the map, from 0.
    reference_stamp_ns : int
        When the reference was taken, nanoseconds.
    score : float
        Sequence score in [0, 1].
    shift : tuple of 2 floats, optional
        Rows and columns, in cells, by which regions moved from query to reference, if the way of
        matching tells.

    """

    reference_index: int
    reference_stamp_ns: int
    score: float
    shift: Shift | None = None


@dataclass(frozen=True, slots=True)
class Match:
    """
    The answer to one frame.

    Parameters
    ----------
    query_index : int
        Frames processed before this one.
    query_stamp_ns : int
        Stamp of the frame, nanoseconds.
    status, reason : Status, Reason
        What was decided and why.
    candidates : tuple of Candidate
        Best first; empty if the frame was skipped.
    sequence_length : int
        Frames matched together, k in the paper; 0 if it could not be chosen.
    pairs_scored : int
        Image pairs compared for this frame.
    confidence : float, optional
        Probability in [0, 1] that the best candidate is right, if calibrated.
    shift_px : tuple of 2 floats, optional
        The best candidate's shift in pixels of the query image: rows, columns. Positive columns:
        what the query shows is further right in the reference.
    relative_yaw_rad : float, optional
        By how much the query's camera is turned against the reference's, counter-clockwise seen
        from above (REP-103), if the shift and the camera are known. Turned left, positive, it
        sees things further right than the reference does: negative columns.

    """

    query_index: int
    query_stamp_ns: int
    status: Status
    reason: Reason
    candidates: tuple[Candidate, ...] = ()
    sequence_length: int = 0
    pairs_scored: int = 0
    confidence: float | None = None
    shift_px: Shift | None = None
    relative_yaw_rad: float | None = None

    @property
    def best(self) -> Candidate | None:
        """The best candidate, accepted or not."""
        return self.candidates[0] if self.candidates else None

    @property
    def accepted(self) -> Candidate | None:
        """The best candidate if it was accepted."""
        return self.best if self.status is Status.ACCEPTED else None
