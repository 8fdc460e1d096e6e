# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rigid motions: poses as 4 x 4 matrices, and the axes of lenses and robots.

The matrix `a_b` is the pose of frame b in frame a; it transforms points from b to a. Axes of a
lens: x right, y down, z ahead. Axes of a robot: x ahead, y left, z up (REP-103).
"""

import math

from convseq_ros.core.types import Camera, Doubles, Pose, Quaternion, Vector
import cv2
import numpy as np
import numpy.typing as npt

Matrix = Doubles

ROBOT_LENS = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def matrix(pose: Pose) -> Matrix:
    """Return the matrix (4, 4) of a pose."""
    x, y, z, w = pose.orientation
    moved = np.eye(4)
    moved[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    moved[:3, 3] = pose.position
    return moved


def pose_of(moved: Matrix) -> Pose:
    """Return the pose of a matrix (4, 4)."""
    return Pose(vector(moved[:3, 3]), quaternion(moved[:3, :3]))


def vector(numbers: Matrix) -> Vector:
    """Return the three numbers of an array (3,) as a tuple."""
    x, y, z = numbers.tolist()
    return x, y, z


def inverse(moved: Matrix) -> Matrix:
    """Return the inverse (4, 4) of a rigid motion."""
    back = np.eye(4)
    back[:3, :3] = moved[:3, :3].T
    back[:3, 3] = -moved[:3, :3].T @ moved[:3, 3]
    return back


def turned_by(turn: npt.ArrayLike) -> Matrix:
    """Return the rotation (3, 3) of a rotation vector (3,): an axis times the angle in radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0])


def difference(first: Matrix, second: Matrix) -> Matrix:
    """Return the motion (6,) from one pose to another: x, y, z and a turn, in the first's axes."""
    moved = inverse(first) @ second
    return np.r_[moved[:3, 3], cv2.Rodrigues(moved[:3, :3])[0].ravel()]


def motion(numbers: Matrix) -> Matrix:
    """Return the motion (4, 4) of what `difference` returns, (6,)."""
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = turned_by(numbers[3:]), numbers[:3]
    return moved


def cross(left: Matrix) -> Matrix:
    """Return the matrix (3, 3) of the cross product with a vector (3,) on the left."""
    x, y, z = left.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def composed_covariance(far: Matrix, of_far: Matrix, near: Matrix, of_near: Matrix) -> Matrix:
    """
    Return the covariance (6, 6) of the motion `far @ near` from the covariances of both.

    Each is of x, y, z and the rotations about them, in the axes of its motion's first frame.
    """
    turn = far[:3, :3]
    turned = np.kron(np.eye(2), turn)
    moved = moved_covariance(of_far, turn @ near[:3, 3])
    return np.asarray(moved + turned @ of_near @ turned.T)


def moved_covariance(covariance: Matrix, moved: Matrix) -> Matrix:
    """Return the covariance (6, 6) of a pose where a rigid arm `moved`, (3,), from it ends."""
    arm = np.eye(6)
    arm[:3, 3:] = -cross(moved)
    return np.asarray(arm @ covariance @ arm.T)


def quaternion(rotation: Matrix) -> Quaternion:
    """Return the unit quaternion x, y, z, w >= 0 of a rotation matrix (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # Column k is the quaternion times 4 times its component k; the largest column is exact.
    products = np.array(
        [
            [1 + a - e - i, b + d, c + g, h - f],
            [b + d, 1 - a + e - i, f + h, c - g],
            [c + g, f + h, 1 - a - e + i, d - b],
            [h - f, c - g, d - b, 1 + a + e + i],
        ]
    )
    best = products[:, products.diagonal().argmax()]
    x, y, z, w = (best / np.linalg.norm(best) * (1 if best[3] >= 0 else -1)).tolist()
    return x, y, z, w


def of_roll_pitch_yaw(position: Vector, roll: float, pitch: float, yaw: float) -> Pose:
    """Return a pose from rotations about the fixed x, then y, then z axis (REP-103), radians."""
    turn = turned_by((0, 0, yaw)) @ turned_by((0, pitch, 0)) @ turned_by((roll, 0, 0))
    return Pose(position, quaternion(turn))


def as_parameter(mount: Pose) -> str:
    """Return a mount as `camera_to_base` takes it: x y z in metres, roll pitch yaw in radians."""
    turn = matrix(mount)[:3, :3]
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
    roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    return ' '.join(
        f'{round(number, 4) + 0.0:g}' for number in (*mount.position, roll, pitch, yaw)
    )


def base_between(camera: Camera, other: Camera) -> Matrix:
    """Return the pose (4, 4) of another robot's base in a robot's, if their cameras coincide."""
    if camera.mount is None or other.mount is None or camera.mount == other.mount:
        return np.eye(4)
    return matrix(camera.mount) @ inverse(matrix(other.mount))


def angle(rotation: Matrix) -> float:
    """Return the angle of a rotation (3, 3) in radians, 0 to pi."""
    return math.acos(min(1.0, max(-1.0, (float(np.trace(rotation)) - 1) / 2)))
