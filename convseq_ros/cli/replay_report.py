# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a replay: what each frame was matched with, `convseq replay --report`."""

import json
from pathlib import Path

from convseq_ros.app.match_picture import answer_picture
from convseq_ros.cli.map_picture import draw_arcs, draw_drives
from convseq_ros.cli.options import warn
from convseq_ros.config import flatten
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import Matrix, matrix
from convseq_ros.core.types import Doubles, Frame, Match, Reason
from convseq_ros.errors import printable
from convseq_ros.evaluation.plots import new_figure, svg
from convseq_ros.evaluation.report.page import Pair, Section, write_page
from convseq_ros.pose_graph.alignment import agreed
import cv2
import numpy as np

COLORS = {
    Reason.ACCEPTED: '#2f9e44', Reason.AMBIGUOUS: '#f08c00', Reason.WEAK: '#ffd43b',
    Reason.TOO_FEW_RIVALS: '#9c36b5', Reason.IMPLAUSIBLE: '#e03131', Reason.COOL_DOWN: '#66d9a8',
    Reason.RECENT: '#4dabf7', Reason.STATIONARY: '#748ffc', Reason.BETWEEN_KEYFRAMES: '#adb5bd',
    Reason.WARMING_UP: '#3bc9db', Reason.UNINFORMATIVE: '#868e96', Reason.UNREADABLE: '#c2255c',
    Reason.OUT_OF_ORDER: '#f783ac', Reason.NO_MAP: '#a08060', Reason.MAP_TOO_SHORT: '#c0a080',
}  # fmt: skip
_QUALITY = 60  # of a pair's JPEG, in percent: some 25 kB
_REPEATED = Reason.STATIONARY, Reason.BETWEEN_KEYFRAMES  # the answer is that of a frame before


class ReplayReport:
    """Collects the answers of a replay, as a listener of it; some 25 kB for each picture."""

    def __init__(self) -> None:
        self._pairs: dict[str, list[Pair]] = {_words(reason): [] for reason in COLORS}
        self._answers: list[tuple[Reason, float, float]] = []  # and confidence, seconds
        self._start_ns = 0
        self._where: list[tuple[float, ...]] = []  # x and y of each frame, by odometry
        self._places = dict[int, int]()  # of accepted frames, by their position
        self._fixes: list[tuple[Matrix, Matrix]] = []  # of some: in the map, by odometry

    def add(
        self, frame: Frame, match: Match, recognizer: PlaceRecognizer, _duration_ms: float
    ) -> None:
        """Take in the newest frame and its answer."""
        best, pose, position = match.best, frame.pose, len(self._where)
        self._start_ns = self._start_ns or match.query_stamp_ns
        self._where.append(pose.position[:2] if pose else (np.nan, np.nan))
        at_s = (match.query_stamp_ns - self._start_ns) / 1e9
        confidence = best.score if best and match.confidence is None else match.confidence
        self._answers.append((match.reason, np.nan if confidence is None else confidence, at_s))
        if best is None or match.reason in _REPEATED:
            return
        if match.accepted:
            self._places[position] = best.reference_index
            if pose and match.pose:
                self._fixes.append((matrix(match.pose.pose), matrix(pose)))
        picture = answer_picture(frame, match, recognizer)
        jpeg = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        caption = _caption(frame, match, recognizer.reference_map, at_s)
        self._pairs[_words(match.reason)].append(Pair(caption, (jpeg,)))

    def write(self, output: Path, title: str, recognizer: PlaceRecognizer) -> None:
        """Write the page; warn of what it lacks."""
        above = self._above(recognizer)
        lacks = [] if self._places else ['no frame was accepted']
        lacks += [] if above else ['nothing is drawn from above, which needs --odom or --poses']
        for problem in lacks:
            warn(f'{output}: {problem}')
        facts = (
            f'{len(self._where)} frames',
            f'{len(self._places)} accepted',
            f'map of {len(recognizer.reference_map)}',
            *lacks,
        )
        told = 'Left: the frame; right: its best place. Dots of one colour agree.'
        section = Section('Answers', told, [self._over_time(recognizer), *above], self._pairs)
        settings = json.dumps(flatten(recognizer.config), indent=1)
        write_page(output, title, ' · '.join(facts), [section], {'settings': settings})

    def _over_time(self, recognizer: PlaceRecognizer) -> tuple[str, str]:
        """Return caption and chart of the confidence of each frame."""
        axes = (figure := new_figure(5, 3.6)).add_subplot()
        for reason, color in COLORS.items():
            points = [answer[:0:-1] for answer in self._answers if answer[0] is reason]
            if points:
                name = f'{_words(reason)} {len(points)}'
                axes.scatter(*zip(*points, strict=True), s=8, color=color, label=name)
        if recognizer.config.believes:
            threshold = recognizer.config.acceptance.min_confidence
            axes.axhline(threshold, color='0.5', linestyle='--', linewidth=1)
        axes.set(xlabel='s', ylabel='confidence')
        axes.legend(fontsize='x-small', loc='upper left', bbox_to_anchor=(1.01, 1), frameon=False)
        return 'Confidence over time. Dashed: accepted from here on.', svg(figure)

    def drive(self, recognizer: PlaceRecognizer) -> Doubles:
        """Return x and y of each frame (n, 2) in the frame of the map; NaN where not known."""
        drive = np.array(self._where).reshape(-1, 2)
        if recognizer.config.online.grows:
            return drive  # is in the map
        if self._fixes:  # the drive lies where most of them say
            moved = agreed(self._fixes)
            return np.asarray(drive @ moved[:2, :2].T + moved[:2, 3])
        has_poses = np.isfinite(recognizer.reference_map.places.columns['pose'][:, 0]).any()
        return np.full_like(drive, np.nan) if has_poses else drive

    def _above(self, recognizer: PlaceRecognizer) -> list[tuple[str, str]]:
        """Return caption and chart of map, drive, and arcs to places; none without poses."""
        places = recognizer.reference_map.places.columns['pose'][:, :2]  # NaN where unknown
        points = {int(at): places[at] for at in np.flatnonzero(np.isfinite(places).all(axis=1))}
        drive = self.drive(recognizer)
        if not points and not np.isfinite(drive).any():
            return []
        axes = (figure := new_figure(6, 4.5)).add_subplot()
        axes.plot(*drive.T, linewidth=2.5, color='black', label='this drive')
        ends = ((drive[at], places[to]) for at, to in self._places.items() if to in points)
        known = ((start, end) for start, end in ends if np.isfinite(start).all())
        draw_arcs(axes, known, COLORS[Reason.ACCEPTED])
        draw_drives(axes, recognizer.reference_map, points)
        axes.legend(fontsize='small')
        return [('From above. Arcs lead from accepted frames to their places.', svg(figure))]


def _words(reason: Reason) -> str:
    return reason.value.replace('_', ' ')


def _caption(frame: Frame, match: Match, reference_map: ReferenceMap, at_s: float) -> str:
    """Return what is said of a frame and its best place, in three lines."""
    best = match.best
    assert best is not None
    number = reference_map.places.session(best.reference_index)
    session = printable(reference_map.sessions[number].name) or f'session {number}'
    figures = [f'score {best.score:.3f}']
    figures += [] if match.confidence is None else [f'confidence {match.confidence:.3f}']
    figures += [] if best.inliers is None else [f'{best.inliers} regions agree']
    if match.relative_pose and (moved := match.relative_pose.position_m):
        figures.append(f'the frame is {moved[0]:.2f} m ahead, {moved[1]:.2f} m left')
    if match.implausible_m is not None:
        figures.append(f'{match.implausible_m:.1f} m beyond what odometry allows')
    return (
        f'Frame {match.query_index}, {at_s:.1f} s, {printable(frame.source)}: '
        f'{_words(match.reason)}\nPlace {best.reference_index} of {session}\n{", ".join(figures)}'
    )
