# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The error of a path against the truth, and the cost of false closures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from statistics import median

from graph import Closure, Odometry, optimise, Solution
import numpy as np
import numpy.typing as npt

Truth = Mapping[int, tuple[float, float]]  # x, y in metres by the stamps of the odometry
Points = npt.NDArray[np.float64]  # (N, 2): x, y in metres; of two paths at the same times
_APART_M, _APART_NS = 20.0, 30_000_000_000
_SAME_M = 5.0


@dataclass(frozen=True, slots=True)
class Trial:
    """Several graphs with the same number of false closures, drawn anew for each."""

    false: int  # number of false closures
    robust: bool  # by graduated non-convexity; otherwise all closures are used
    errors_m: tuple[float, ...]  # trajectory error of each graph
    right_kept: tuple[int, ...]  # closures that each graph kept
    false_kept: tuple[int, ...]

    @property
    def median_m(self) -> float:
        """The median error."""
        return median(self.errors_m)


def draw_false(rng: np.random.Generator, truth: Truth, count: int) -> list[Closure]:
    """Return closures between places at least 20 m apart, visited at least 30 s apart."""
    stamps = sorted(truth)
    closures: list[Closure] = []
    while len(closures) < count:
        reference_ns, query_ns = sorted(stamps[i] for i in rng.integers(0, len(stamps), 2))
        far = math.dist(truth[reference_ns], truth[query_ns]) >= _APART_M
        if far and query_ns - reference_ns >= _APART_NS:
            closures.append(Closure(query_ns, reference_ns))
    return closures


def error_m(solution: Solution, truth: Truth, before: bool = False) -> float:
    """Return the trajectory error of a solution, or of its odometry."""
    path = solution.before if before else solution.after
    return absolute_error_m(path[:, :2], true_path(solution, truth))


def twice(solution: Solution, truth: Truth) -> npt.NDArray[np.bool_]:
    """Return flags (N,) of keyframes at places that were also visited 30 s before or later."""
    real, stamps_ns = true_path(solution, truth), solution.stamps_ns
    near = np.linalg.norm(real[:, None] - real[None], axis=2) <= _SAME_M
    return (near & (np.abs(stamps_ns[:, None] - stamps_ns[None]) >= _APART_NS)).any(axis=1)


def true_path(solution: Solution, truth: Truth) -> npt.NDArray[np.float64]:
    """Return the true positions of the keyframes, (N, 2)."""
    return np.array([truth[stamp_ns] for stamp_ns in solution.stamps_ns.tolist()])


def compare(
    odometry: Odometry, right: Sequence[Closure], truth: Truth, counts: Sequence[int], draws: int
) -> list[Trial]:
    """
    Return a trial for every number of false closures, without and with robust optimisation.

    False closures are added to the `right` ones of the place recogniser, and drawn anew `draws`
    times. Without false closures there is a single graph.
    """
    trials = []
    for count in counts:
        closure_sets = [
            [*right, *draw_false(np.random.default_rng((count, draw)), truth, count)]
            for draw in range(draws if count else 1)
        ]
        for robust in (False, True):
            solutions = [optimise(odometry, closures, robust=robust) for closures in closure_sets]
            trials.append(
                Trial(
                    count,
                    robust,
                    tuple(error_m(solution, truth) for solution in solutions),
                    tuple(sum(solution.kept[: len(right)]) for solution in solutions),
                    tuple(sum(solution.kept[len(right) :]) for solution in solutions),
                )
            )
    return trials


def aligned(estimate: Points, truth: Points) -> Points:
    """Return a path rotated and shifted (SE2, no scale) to the best fit with the truth."""
    centre, true_centre = estimate.mean(axis=0), truth.mean(axis=0)
    left, _, right = np.linalg.svd((truth - true_centre).T @ (estimate - centre))
    flip = np.diag((1.0, np.sign(np.linalg.det(left @ right))))
    moved: Points = (estimate - centre) @ (left @ flip @ right).T + true_centre
    return moved


def rmse_m(estimate: Points, truth: Points) -> float:
    """Return the root mean square distance of two paths (N, 2) in metres, without alignment."""
    return float(np.sqrt(np.mean(np.sum((estimate - truth) ** 2, axis=1))))


def absolute_error_m(estimate: Points, truth: Points) -> float:
    """Return the absolute trajectory error: the distance after alignment."""
    return rmse_m(aligned(estimate, truth), truth)
