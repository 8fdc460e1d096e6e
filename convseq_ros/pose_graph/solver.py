# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The solution of a pose graph that grows: iSAM2, and anew where closures contradict."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
import math
from threading import Lock
from typing import Any

from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import constants
from convseq_ros.pose_graph.edges import Edge, Poses
from convseq_ros.pose_graph.optimisation import (
    factor_of,
    isam_settings,
    need_gtsam,
    optimise,
    priors,
    ROBUST,
    Solution,
    squares_of,
    values_of,
)
import numpy as np


@constants
class INCREMENTAL:
    """How iSAM2 (Kaess, IJRR 2012) follows; engineering, not studied."""

    relinearised: int = 100  # updates after which what moved is made linear again
    stirred: float = 0.01  # metres or radians by which a pose moves, to move others with it
    doubted: float = 0.03  # share of links with a doubtful verdict up to which it goes on
    reviewed: int = 32  # earlier links whose error is computed again with each update, in turn


class Solver:
    """
    Keeps the solution of a graph, to extend it.

    What is asked extends what was asked before: nodes, odometry steps and links are added.
    A link that contradicts the solution is refused at once, as long as few do: then graduated
    non-convexity would do the same. When more contradict, it decides on all links.

    An update computes few poses, since all of them take longer than the rest; a solution that is
    asked for all of them gets the newest ones, in any thread.
    """

    def __init__(self) -> None:
        self._isam: Any = None
        self._steps = 0  # of odometry, that it has
        self._held: Mapping[int, float] = {}
        self._factors = dict[Edge, Any]()  # of links
        self._errors = dict[Edge, float]()  # of links, when they were reviewed last
        self._all: Any = None  # the poses, when they were computed last
        self._changing = Lock()
        self._newest = 0  # pose
        self._turn = 0  # of the next link to review
        self._refused, self._doubted = set[Edge](), set[Edge]()

    def extended(
        self, new: Poses, steps: Sequence[Edge], links: Sequence[Edge], held: Mapping[int, float]
    ) -> Solution | None:
        """Take in new nodes and what is new else; None if too many links contradict."""
        if self._isam is None or held != self._held:
            return None
        graph = need_gtsam().NonlinearFactorGraph()
        for step in steps[self._steps :]:
            graph.add(factor_of(step))
        self._steps, far = len(steps), list[Edge]()
        fresh = [link for link in links if link not in self._factors]
        reviewed = [*fresh, *self._turns([*self._errors])]
        try:
            for link in fresh:
                if 2 * self._factor(link).error(self._ends(link, new)) > ROBUST.inlier:
                    far.append(link)
                else:
                    graph.add(self._factor(link))
            self._newest = max([self._newest, *new])
            with self._changing:
                self._isam.update(graph, values_of(new))
                if far:
                    self._take_in(far)
                values = self._at({*(at for link in reviewed for at in link.ends), *new})
        except (RuntimeError, LookupError, ValueError):  # GTSAM's: it has no solution from here
            return None
        squares = squares_of([self._factors[link] for link in reviewed], values)
        for link, square in zip(reviewed, squares.tolist(), strict=True):
            self._errors[link] = math.sqrt(square)
            if (square <= ROBUST.inlier) is (link in self._refused):
                self._doubted.add(link)
        if len(self._doubted) > INCREMENTAL.doubted * len(links):
            return None
        kept = tuple(link not in self._refused for link in links)
        errors = tuple(self._errors[link] for link in links)
        return Solution(values, kept, errors, self._whole, self._spread())

    def _turns(self, links: Sequence[Edge]) -> list[Edge]:
        """Return the links whose turn it is to be reviewed."""
        ahead = [*links[self._turn :], *links[: self._turn]]
        self._turn = (self._turn + INCREMENTAL.reviewed) % max(1, len(links))
        return ahead[: INCREMENTAL.reviewed]

    def _at(self, indices: Iterable[int]) -> Any:
        """Return some poses of iSAM2, as GTSAM has them."""
        values = need_gtsam().Values()
        for at in indices:
            values.insert(at, self._isam.calculateEstimatePose3(at))
        return values

    def pose(self, index: int) -> Matrix | None:
        """Return a pose (4, 4), as it is now; None if it is not solved."""
        with self._changing:
            if self._isam and self._isam.valueExists(index):
                return np.asarray(self._isam.calculateEstimatePose3(index).matrix())
        return None

    def _whole(self) -> Any:
        """Return all poses, as they are now; as they were where GTSAM has no solution."""
        with self._changing, suppress(RuntimeError, LookupError, ValueError):
            self._all = self._isam.calculateEstimate()
        return self._all

    def _take_in(self, links: Sequence[Edge]) -> None:
        """Add links that are as likely as their errors and those of the solution allow."""
        graph = need_gtsam().NonlinearFactorGraph()
        for link in links:
            if self._is_unlikely(link):
                self._refused.add(link)
                self._doubted.add(link)
            else:
                graph.add(self._factors[link])
        self._isam.update(graph, need_gtsam().Values())

    def _is_unlikely(self, link: Edge) -> bool:
        """Return whether a link is further off than its errors and those of its ends explain."""
        factor = self._factors[link].linearize(self._ends(link, {}))
        motion, error = factor.jacobian()  # in standard deviations

        def is_outside(ends: Matrix) -> bool:
            spread = np.eye(6) + motion @ ends @ motion.T
            return bool(error @ np.linalg.solve(spread, error) > ROBUST.inlier)

        # Twice the covariance of each end is at least that of both, and takes a thirtieth as long.
        most = np.zeros((12, 12))
        for at, block in zip(link.ends, (slice(6), slice(6, 12)), strict=True):
            most[block, block] = 2 * self._isam.marginalCovariance(at)
        if is_outside(most):
            return True
        return is_outside(self._isam.jointMarginalCovariance([*link.ends]).fullMatrix())

    def _ends(self, link: Edge, new: Poses) -> Any:
        """Return the poses at the ends of a link, which may be new, as GTSAM has them."""
        values = self._at({*link.ends} - new.keys())
        for at in {*link.ends} & new.keys():
            values.insert(at, need_gtsam().Pose3(new[at]))
        return values

    def anew(
        self, poses: Poses, steps: Sequence[Edge], links: Sequence[Edge], held: Mapping[int, float]
    ) -> Solution:
        """Decide on all links, by graduated non-convexity; ConvseqError without GTSAM."""
        solution = optimise([*steps, *links], poses, held)
        self._refused = {link for link, kept in zip(links, solution.kept, strict=True) if not kept}
        gtsam, graph = need_gtsam(), priors(poses, held)
        for step in steps:
            graph.add(factor_of(step))
        for link in links:
            factor = self._factor(link)
            if link not in self._refused:
                graph.add(factor)
        settings = isam_settings()
        settings.relinearizeSkip = INCREMENTAL.relinearised
        step = gtsam.ISAM2GaussNewtonParams()
        step.setWildfireThreshold(INCREMENTAL.stirred)
        settings.setOptimizationParams(step)
        isam = gtsam.ISAM2(settings)
        isam.update(graph, solution.values)
        with self._changing:
            self._isam, self._all = isam, solution.values
        self._held, self._steps, self._doubted = held, len(steps), set()
        self._newest = max(poses)
        self._errors = dict(zip(links, solution.errors, strict=True))
        return replace(solution, spread=self._spread())

    def _spread(self) -> Matrix | None:
        """Return the covariance (6, 6) of the newest pose; None where GTSAM has none."""
        with self._changing, suppress(RuntimeError, LookupError, ValueError):
            covariance = self._isam.marginalCovariance(self._newest)
            return np.roll(covariance, (3, 3), (0, 1))  # GTSAM has turns first
        return None

    def _factor(self, link: Edge) -> Any:
        if link not in self._factors:
            self._factors[link] = factor_of(link)
        return self._factors[link]
