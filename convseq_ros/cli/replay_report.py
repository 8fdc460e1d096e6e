# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a replay: what each frame was matched with, `convseq replay --report`."""

from pathlib import Path

from convseq_ros.cli.options import warn
from convseq_ros.config import flatten
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import slices_of
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import Matrix, matrix
from convseq_ros.core.types import Candidate, Frame, Match, Reason
from convseq_ros.errors import printable
from convseq_ros.evaluation.report.above import drawn_above, Line
from convseq_ros.evaluation.report.matches import MatchPage, Texts
from convseq_ros.evaluation.report.pairs import Pair, pair_of_frame
from convseq_ros.pose_graph.alignment import agreed
import numpy as np

# By reason, as the words of the page.
COLORS = {
    Reason.ACCEPTED: '#2f9e44', Reason.AMBIGUOUS: '#f08c00', Reason.WEAK: '#ffd43b',
    Reason.TOO_FEW_RIVALS: '#9c36b5', Reason.IMPLAUSIBLE: '#e03131', Reason.COOL_DOWN: '#66d9a8',
    Reason.RECENT: '#4dabf7', Reason.STATIONARY: '#748ffc', Reason.BETWEEN_KEYFRAMES: '#adb5bd',
    Reason.WARMING_UP: '#3bc9db', Reason.UNINFORMATIVE: '#868e96', Reason.UNREADABLE: '#c2255c',
    Reason.OUT_OF_ORDER: '#f783ac', Reason.NO_MAP: '#a08060', Reason.MAP_TOO_SHORT: '#c0a080',
}  # fmt: skip
_REPEATED = Reason.STATIONARY, Reason.BETWEEN_KEYFRAMES  # the answer is that of a frame before


class ReplayReport:
    """Collects the answers of a replay of about `expected` frames, as a listener of it."""

    def __init__(self, expected: int) -> None:
        colors = {_words(reason): color for reason, color in COLORS.items()}
        self._page, self._start_ns = MatchPage(expected, _words(Reason.ACCEPTED), colors), 0
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
        confidence = best.score if best and match.confidence is None else match.confidence
        answer = _words(match.reason), confidence, (match.query_stamp_ns - self._start_ns) / 1e9
        if best is None or match.reason in _REPEATED:
            self._page.add(*answer)
            return
        place = best.reference_index
        if match.accepted:
            self._places[position] = place
            if pose and match.pose:
                self._fixes.append((matrix(match.pose.pose), matrix(pose)))

        def make(best: Candidate = best) -> tuple[Texts, Pair]:
            texts = _texts(frame, match, best, recognizer.reference_map, answer[2])
            return texts, pair_of_frame(frame, place, recognizer, self._page.width_px)

        self._page.add(*answer, make)

    def write(self, output: Path, title: str, recognizer: PlaceRecognizer) -> None:
        """Write the page; warn of what it lacks."""
        config, above = recognizer.config, self._above(recognizer)
        lacks = [] if self._places else ['no frame was accepted']
        lacks += [] if above else ['nothing is drawn from above, which needs --odom or --poses']
        if self._page.pictured == {False}:
            lacks.append('the map keeps no pictures; build it again')
        for problem in lacks:
            warn(f'{output}: {problem}')
        size = len(recognizer.reference_map)
        facts = f'{len(self._where)} frames', f'{len(self._places)} accepted', f'map of {size}'
        self._page.write(
            output,
            title,
            (*facts, *lacks),
            above,
            flatten(config),
            'Height: confidence. Colour: the answer. Dashed: accepted from here on.',
            axis='s',
            threshold=config.acceptance.min_confidence if config.believes else None,
        )

    def _above(self, recognizer: PlaceRecognizer) -> str:
        """Return the map, the drive, and arcs to the places of accepted frames, from above."""
        drive, lines = (
            np.array(self._where).reshape(-1, 2),
            session_lines(recognizer.reference_map),
        )
        places = recognizer.reference_map.places.columns['pose'][:, :2]  # NaN where unknown
        if not recognizer.config.online.grows:  # else the drive is in the map
            if self._fixes:  # the drive lies where most of them say
                moved = agreed(self._fixes)
                drive = drive @ moved[:2, :2].T + moved[:2, 3]
            elif np.isfinite(places).any():
                drive = np.full_like(drive, np.nan)  # nobody knows where it lies
            lines.insert(0, ('this drive', drive))
        arcs = []
        for position, place in self._places.items():
            ends = np.array((drive[position], places[place]))
            ends[0] = np.where(np.isfinite(ends[0]), *ends)  # a dot if the start is not known
            arcs.append((position, COLORS[Reason.ACCEPTED], ends))
        return drawn_above(lines, arcs)


def session_lines(reference_map: ReferenceMap) -> list[Line]:
    """Return the sessions of a map, from above."""
    points, slices = (
        reference_map.places.columns['pose'][:, :2],
        slices_of(Path('session'), reference_map),
    )
    return [(printable(part.session.name), points[[*part.places]]) for part in slices]


def place_text(reference_map: ReferenceMap, index: int) -> str:
    """Return what a place is called."""
    number = reference_map.places.session(index)
    name = reference_map.sessions[number].name
    return f'Place {index} of {printable(name) or f"session {number}"}'


def _words(reason: Reason) -> str:
    return reason.value.replace('_', ' ')


def _texts(
    frame: Frame, match: Match, best: Candidate, reference_map: ReferenceMap, at_s: float
) -> Texts:
    """Return the texts about the answer, the frame and the place."""
    figures = [f'score {best.score:.3f}']
    figures += [] if match.confidence is None else [f'confidence {match.confidence:.3f}']
    figures += [] if best.inliers is None else [f'{best.inliers} regions agree']
    if match.relative_pose and (moved := match.relative_pose.position_m):
        figures.append(f'the frame is {moved[0]:.2f} m ahead, {moved[1]:.2f} m left')
    if match.implausible_m is not None:
        figures.append(f'{match.implausible_m:.1f} m beyond what odometry allows')
    answer = 'accepted' if match.accepted else f'refused, {_words(match.reason)}'
    return (
        f'Frame {match.query_index}: {answer}',
        f'Frame {match.query_index}\n{at_s:.1f} s, {printable(frame.source)}',
        f'{place_text(reference_map, best.reference_index)}\n{", ".join(figures)}',
    )
