# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The solution of a pose graph that grows: iSAM2, and anew where closures contradict."""

from collections.abc import Mapping, Sequence
from typing import Any

from convseq_ros.core.types import constants
from convseq_ros.pose_graph.edges import Edge, Poses
from convseq_ros.pose_graph.optimisation import (
    factor_of,
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
    doubted: float = 0.03  # share of links with a doubtful verdict up to which it goes on


class Solver:
    """
    Keeps the solution of a graph, to extend it.

    What is asked extends what was asked before: nodes, odometry steps and links are added.
    A link that contradicts the solution is refused at once, as long as few do: then graduated
    non-convexity would do the same. When more contradict, it decides on all links.
    """

    def __init__(self) -> None:
        self._isam: Any = None
        self._steps = 0  # of odometry, that it has
        self._held: Mapping[int, float] = {}
        self._factors = dict[Edge, Any]()  # of links
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
        try:
            for link in [link for link in links if link not in self._factors]:
                if 2 * self._factor(link).error(self._ends(link, new)) > ROBUST.inlier:
                    far.append(link)
                else:
                    graph.add(self._factor(link))
            self._isam.update(graph, values_of(new))
            if far:
                self._take_in(far)
            values = self._isam.calculateEstimate()
        except (RuntimeError, LookupError, ValueError):  # GTSAM's: it has no solution from here
            return None
        squares = squares_of([self._factors[link] for link in links], values)
        kept = [link not in self._refused for link in links]
        contrary = np.flatnonzero((squares <= ROBUST.inlier) != kept)
        self._doubted |= {links[int(at)] for at in contrary}
        if len(self._doubted) > INCREMENTAL.doubted * len(links):
            return None
        return Solution(values, tuple(kept), tuple(np.sqrt(squares).tolist()))

    def _take_in(self, links: Sequence[Edge]) -> None:
        """Add links that are as likely as their errors and those of the solution allow."""
        graph = need_gtsam().NonlinearFactorGraph()
        for link in links:
            factor = self._factors[link].linearize(self._ends(link, {}))
            motion, error = factor.jacobian()  # in standard deviations
            ends = self._isam.jointMarginalCovariance([link.start, link.end]).fullMatrix()
            spread = np.eye(6) + motion @ ends @ motion.T
            if error @ np.linalg.solve(spread, error) > ROBUST.inlier:
                self._refused.add(link)
                self._doubted.add(link)
            else:
                graph.add(self._factors[link])
        self._isam.update(graph, need_gtsam().Values())

    def _ends(self, link: Edge, new: Poses) -> Any:
        """Return the poses at the ends of a link, which may be new, as GTSAM has them."""
        values = values_of({at: new[at] for at in (link.start, link.end) if at in new})
        for at in {link.start, link.end} - new.keys():
            values.insert(at, self._isam.calculateEstimatePose3(at))
        return values

    def anew(
        self, poses: Poses, steps: Sequence[Edge], links: Sequence[Edge], held: Mapping[int, float]
    ) -> Solution:
        """Decide on all links, by graduated non-convexity; ConvseqError without GTSAM."""
        self._isam, self._doubted = None, set()
        solution = optimise([*steps, *links], poses, held)
        self._refused = {link for link, kept in zip(links, solution.kept, strict=True) if not kept}
        gtsam, graph = need_gtsam(), priors(poses, held)
        for step in steps:
            graph.add(factor_of(step))
        for link in links:
            factor = self._factor(link)
            if link not in self._refused:
                graph.add(factor)
        settings = gtsam.ISAM2Params()
        settings.relinearizeSkip = INCREMENTAL.relinearised
        isam = gtsam.ISAM2(settings)
        isam.update(graph, solution.values)
        self._isam, self._held, self._steps = isam, held, len(steps)
        return solution

    def _factor(self, link: Edge) -> Any:
        if link not in self._factors:
            self._factors[link] = factor_of(link)
        return self._factors[link]
