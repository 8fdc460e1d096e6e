# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rigid motions: poses as 4 x 4 matrices, and the axes of lenses and robots.

A matrix `a_b` of a frame b in a frame a takes points of b to a. A lens has x right, y down, z
ahead; a robot x ahead, y left, z up (REP-103).
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
    """Return the pose that a matrix (4, 4) is."""
    return Pose(vector(moved[:3, 3]), quaternion(moved[:3, :3]))


def vector(numbers: Matrix) -> Vector:
    """Return three numbers of an array."""
    x, y, z = numbers.tolist()
    return x, y, z


def inverse(moved: Matrix) -> Matrix:
    """Return the motion back."""
    back = np.eye(4)
    back[:3, :3] = moved[:3, :3].T
    back[:3, 3] = -moved[:3, :3].T @ moved[:3, 3]
    return back


def turned_by(turn: npt.ArrayLike) -> Matrix:
    """Return the rotation (3, 3) about an axis by its length in radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0])


def cross(one: Matrix) -> Matrix:
    """Return the matrix (3, 3) that takes a vector to its cross product with one."""
    x, y, z = one.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def composed_covariance(far: Matrix, of_far: Matrix, near: Matrix, of_near: Matrix) -> Matrix:
    """
    Return the covariance (6, 6) of the motion `far @ near` by those of both.

    Each is of x, y, z and turns about them, in the axes from which its motion leads.
    """
    turn, arm = far[:3, :3], np.eye(6)
    arm[:3, 3:] = -cross(turn @ near[:3, 3])
    turned = np.kron(np.eye(2), turn)
    return np.asarray(arm @ of_far @ arm.T + turned @ of_near @ turned.T)


def quaternion(rotation: Matrix) -> Quaternion:
    """Return x, y, z, w, of unit length, w not negative, of a rotation matrix (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # Each column is the quaternion, times four of one of its numbers; the largest is exact.
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
    """Return a pose that is turned about the fixed x, then y, then z axis (REP-103), radians."""
    turn = turned_by((0, 0, yaw)) @ turned_by((0, pitch, 0)) @ turned_by((roll, 0, 0))
    return Pose(position, quaternion(turn))


def base_between(one: Camera, other: Camera) -> Matrix:
    """Return where the base of another camera is in the base of one that is at the same place."""
    if one.mount is None or other.mount is None or one.mount == other.mount:
        return np.eye(4)
    return matrix(one.mount) @ inverse(matrix(other.mount))


def angle(rotation: Matrix) -> float:
    """Return by how much a rotation (3, 3) turns, in radians, 0 to pi."""
    return math.acos(min(1.0, max(-1.0, (float(np.trace(rotation)) - 1) / 2)))
