# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the tables of README and docs/RESULTS.md: ours and common methods, on real places.

Usage: python scripts/peers.py --data FOLDER [--real FOLDER] [--places corridor laps]
[--methods ours HBST], more than an hour on one core. It needs scikit-image and pyhbst. --real has
the drives of real_drives.py; places whose images are not there are left out.

All frames whose place is in the map count; half of the map is removed in turn (*open*). RIGHT says
up to where a match is right, and up to where it is a *slip*, which does not count; all others are
false. *Own* is the method's own decision, with its false matches. *Best* is at the lowest
threshold without a false match on this place, by the criterion (and alpha and k) with the highest
recall; this favours every method. *One threshold* is the same for all places. ms are CPU time per
frame. With --steps, the steps from CoHOG to ours, open and closed, take their place.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
import re
import time

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.config import Config, make_config
from convseq_ros.core.similarity.feature_cache import BACKGROUND
from convseq_ros.core.types import Frame
from convseq_ros.evaluation.data_set import DataSet, open_data_set, Part, TruthSource
from convseq_ros.evaluation.given_scores import PairScores
from convseq_ros.evaluation.images import Images
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.methods import KINDS, make_method, parse_method
from convseq_ros.evaluation.protocols import CLOSED, ONLINE, OPEN, Outcome, run_protocol
from convseq_ros.evaluation.query_answers import QueryAnswers, Scores
from convseq_ros.evaluation.scorecard import judge, Verdicts
from convseq_ros.evaluation.truth import Truth
from drives import head, options, progress, row
from fit_decision import changed, RECORDS
from known_drives import Drive, Make, of_laps, Shown
import numpy as np
import numpy.typing as npt
import real_drives
from real_drives import in_other_light, of_park

READY_MADE = {  # with when a match is right, and up to when it does not count
    'corridor': ('corridor', '2, 5 of 111'),
    'Gardens Point': ('gardens_point_day_day', '2, 5 of 200'),
    'RTAB-Map': ('rtabmap84', '2, 5 of 84'),
}
IN_OTHER_LIGHT = {
    'courtyard evening': ('court evening', '25, 50 of 284'),
    'courtyard noon': ('court noon', '25, 50 of 284'),
    'office': ('office week', '20, 60 of 462'),
    'house': ('house one lap', '8, 20 of 176'),
    'park': ('park', '2, 6 of 101'),
    'room': ('room, hand-held', '8, 2 points'),
}
RIGHT = {  # by place: up to where a match is right, and up to where it does not count
    **{place: rule for place, (_, rule) in READY_MADE.items()},
    'laps': '40, 100 of 840',
    **{place: rule for place, (_, rule) in IN_OTHER_LIGHT.items()},
}
ORIGINAL = 'sift-vlad rows=0'  # images as they are: SIFT finds more in some of them
LARGE = 'Gardens Point', 'house', 'room'  # ... but these are not enlarged
LENGTHS = 1, 10, 20, 40  # frames of a sequence


def along(*texts: str) -> tuple[str, ...]:
    """Return methods, and plain diagonals of their pair scores."""
    return *texts, *(f'diagonal {length} {text}' for text in texts for length in LENGTHS[1:])


METHODS: Mapping[str, Sequence[str]] = {  # with their variants
    'ours': ('convseq',),
    'paper': ('paper',),
    'ORB': along('orb-bow'),
    'SIFT': along('sift-vlad', ORIGINAL),
    'HBST': along('hbst'),
    'SeqSLAM': tuple(f'seqslam ds={length}' for length in LENGTHS),
    'CoHOG': tuple(f'diagonal {length} cohog' for length in LENGTHS),
    'HOG': tuple(f'diagonal {length} hog' for length in LENGTHS),
}
DECIDING = ('ours', 'ORB', 'SIFT', 'HBST')  # others accept each best answer
STEPS = {
    'CoHOG': 'diagonal 1 cohog',
    'no background': 'diagonal 1 single BACKGROUND.fewest_places=1e9',
    'our pair score': 'diagonal 1 single',
    'verified': 'verified',
    'diagonal of 10': 'diagonal 10 single',
    'of 20': 'diagonal 20 single',
    'filter, all places': 'convseq keypoints=0 search=exhaustive',
    'filter': 'convseq keypoints=0',
    '+ keypoints': 'convseq COVISIBLE.by_chance=1e9',
    '+ covisibility': 'convseq',
}
RECORDS['BACKGROUND'] = BACKGROUND  # none of the decision: fit_decision keeps pairs
ALPHAS = 0.3, 0.1, 0.2, 0.5  # DLoopDetector's own first
CONSISTENT = 3, 1  # its own number of frames that agree, and that of its demo
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Run:
    """The results of a variant of a method on a place."""

    text: str
    verdicts: Verdicts
    frame_ms: float
    place_bytes: float

    def false(self, strict: bool = False) -> Flags:
        """Return which answers are false; strictly, slips are as well."""
        return ~self.verdicts.correct & (strict | ~self.verdicts.slip)

    def threshold(self, criterion: str, strict: bool = False) -> float:
        """Return the highest value of a false answer."""
        wrong = self.verdicts.matched & self.false(strict)
        return float(self.verdicts.sure(criterion)[wrong].max(initial=-np.inf))

    def recall(self, accepted: Flags) -> float:
        """Return the share of known frames with a right accepted answer."""
        return float((accepted & self.verdicts.correct).sum() / self.verdicts.known.sum())

    def best(self, strict: bool = False) -> float:
        """Return the recall at the best threshold without a false answer."""
        found = self.verdicts
        thresholds = {name: self.threshold(name, strict) for name in self.criteria}
        return max(self.recall(found.above(*threshold)) for threshold in thresholds.items())

    @property
    def criteria(self) -> list[str]:
        """The criteria for which it has values."""
        values = self.verdicts.values
        return [name for name, found in values.items() if not np.isnan(found).all()]


@dataclass(frozen=True, eq=False)
class Held(Images):
    """Images of a drive, in memory."""

    frames: Sequence[Frame] = ()

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)


@dataclass(frozen=True, slots=True)
class Known(Truth):
    """The truth by places along a lap: between right and false, an answer does not count."""

    near: Flags = field(kw_only=True)  # (Q, R), not clearly false

    @property
    def slip(self) -> Flags:
        return np.asarray(self.near & ~self.right)


def material_of(drive: Drive) -> Material:
    """Return a drive in a map, without its configuration."""

    def held(shown: Shown, what: str) -> Held:
        return Held(Part(Path(f'{drive.name}, {what}')), frames=[frame for frame, _ in shown])

    query, mapped = held(drive.queries, 'query'), held(drive.mapped, 'map')
    places = np.array([place for _, place in drive.mapped])
    off = np.array([drive.off(here, places) for _, here in drive.queries])
    truth = Known(off <= drive.right, near=~(off > drive.wrong))
    name = re.sub(r'\W+', '-', drive.name)
    data_set = DataSet(name, query.part, TruthSource('none'), mapped.part)
    return Material(data_set, query, mapped, truth)


def opener(
    place: str, data: Path, real: Path | None, config: Config
) -> Callable[[], Material] | None:
    """Return what opens a place's images and truth; None if the images are not there."""
    if place in READY_MADE:
        data_set = open_data_set(READY_MADE[place][0], data)
        is_there = data_set.query.path.exists()
        return partial(open_material, data_set, config.encoding) if is_there else None
    folder = data / 'laps' if place == 'laps' else real
    if folder is None or not folder.exists():
        return None
    makes: dict[str, Make] = {
        'laps': partial(of_laps, folder, 'first'),
        'park': partial(of_park, folder, 'park', real_drives.Part('0'), '1'),
        **in_other_light(folder),
    }
    make = makes[IN_OTHER_LIGHT[place][0] if place in IN_OTHER_LIGHT else place]
    return lambda: material_of(make())


class Measured:
    """What was measured of a place, by variant and protocol; none is measured twice."""

    def __init__(self, place: str, open_place: Callable[[], Material], config: Config) -> None:
        self._place, self._open, self._config = place, open_place, config
        self._found: dict[tuple[str, str], tuple[list[Run], Scores]] = {}

    @cached_property
    def material(self) -> Material:
        """The images; they are read when they are first asked for."""
        return self._open()

    def runs(self, text: str, protocol: str) -> list[Run]:
        """Return the runs of a variant."""
        return self._of(text, protocol)[0]

    def _of(self, text: str, protocol: str) -> tuple[list[Run], Scores]:
        if self._place in LARGE and text == ORIGINAL:
            text = 'sift-vlad'
        if (text, protocol) not in self._found:
            progress(f'{self._place}, {protocol}: {text}')
            self._found[text, protocol] = self._measured(text, protocol)
        return self._found[text, protocol]

    def _measured(self, text: str, protocol: str) -> tuple[list[Run], Scores]:
        how = self._config, ONLINE if self.material.data_set.online else protocol
        if not text.startswith('diagonal'):
            return runs(self.material, text, *how)
        _, length, of_what = text.split(maxsplit=2)
        # With half of a map, a recogniser has no scores of all pairs.
        is_peer = 'rows' in KINDS[of_what.split()[0]].options
        (base, *_), scores = self._of(of_what, protocol if is_peer else CLOSED)
        return [diagonal(self.material, text, base, scores, int(length), *how)], scores


def runs(material: Material, text: str, config: Config, protocol: str) -> tuple[list[Run], Scores]:
    """
    Return the runs of a variant, and its pair scores (Q, R).

    RECORD.name=VALUE at its end changes a constant.

    DLoopDetector has one per alpha and number of frames that agree; hbst has one that geometry
    decides, and one that its scores decide.
    """
    asked, *changes = re.split(r' (?=[A-Z]+\.)', text)
    pairs_of = (change.split('=') for change in changes)
    with changed({name: float(value) for name, value in pairs_of}):
        method = make_method(parse_method(asked), config)
        if method.kind.recognizer and protocol == OPEN:  # its scores of all pairs are not needed
            none = np.full(material.truth.right.shape, np.nan, np.float32)
            costs = method.measured(material, QueryAnswers([], [0.0], none))
            method = replace(method, kind=replace(method.kind, rows=lambda *_: costs))
        if 'rows' not in method.kind.options:
            outcome = run_protocol(material, method, protocol)
            return [_run(text, outcome)], outcome.pairs.scores
    pairs, variants = method.rows(material), []
    decisions: list[Callable[..., list[Detection]] | None] = [pairs.detect, None]
    if 'alpha' in method.kind.options:
        assert pairs.detect
        decisions = [
            partial(pairs.detect, alpha=alpha, consistent=frames)
            for alpha, frames in product(ALPHAS, CONSISTENT)
        ]
    for decision in decisions:
        other = replace(pairs, detect=decision)
        kind = replace(method.kind, rows=lambda *_, other=other: other)
        outcome = run_protocol(material, replace(method, kind=kind), protocol)
        variants.append(_run(text, outcome))
    return variants, pairs.scores


def diagonal(
    material: Material,
    text: str,
    base: Run,
    scores: Scores,
    length: int,
    config: Config,
    protocol: str,
) -> Run:
    """Return the run of plain diagonals of so many frames of the pair scores (Q, R) of another."""
    method = make_method(parse_method(f'hog k={length}'), config)
    kind = replace(method.kind, rows=lambda *_: PairScores(scores))
    run = _run(text, run_protocol(material, replace(method, kind=kind), protocol))
    return replace(run, frame_ms=base.frame_ms, place_bytes=base.place_bytes)


def _run(text: str, outcome: Outcome) -> Run:
    pairs = outcome.pairs
    frame_ms = outcome.frame_ms or (pairs.encode_ms or 0.0) + (pairs.row_ms or 0.0)
    return Run(text, judge(outcome), frame_ms, pairs.place_bytes or 0.0)


def main() -> None:
    """Measure, and print a table of places and methods for each figure."""
    chosen = options(
        __doc__, data=Path, real=None, places=(*RIGHT,), methods=(*METHODS,), steps=False
    )
    time.perf_counter = time.process_time  # so that other load does not count
    config = make_config({'threads': 1})
    variants: dict[str, Sequence[str]] = {name: METHODS[name] for name in chosen.methods}
    if chosen.steps:
        variants = {step: (text,) for step, text in STEPS.items()}
    results: dict[str, dict[str, list[Run]]] = {}
    closed: dict[str, dict[str, list[Run]]] = {}
    for place in chosen.places:
        opening = opener(place, chosen.data, chosen.real, config)
        if opening is None:
            progress(f'{place}: its images are not there')
            continue
        measured = Measured(place, opening, config)
        for protocol, found in ((OPEN, results), *([(CLOSED, closed)] * chosen.steps)):
            found[place] = {
                name: [one for text in texts for one in measured.runs(text, protocol)]
                for name, texts in variants.items()
            }
    if not results:
        return
    if chosen.steps:
        _table('steps, open: best, %', results, STEPS, _best)
        _table('steps, closed: best, %', closed, STEPS, _best)
        _table('steps, closed: best answers right, %', closed, STEPS, _right)
        return
    deciding = [method for method in chosen.methods if method in DECIDING]
    _table('own, % (false)', results, deciding, _own)
    _table('own, slips', results, deciding, _slips)
    _table('best, %', results, chosen.methods, _best)
    _table('best, slips are false, %', results, chosen.methods, partial(_best, strict=True))
    _table('ms a frame', results, chosen.methods, _ms)
    _table('kB a place', results, chosen.methods, lambda some: f'{some[0].place_bytes / 1e3:.0f}')
    one = {
        method: max(_for_all([found[method] for found in results.values()]), key=sum)
        for method in chosen.methods
    }
    head('one threshold for all places, best %', *chosen.methods)
    for number, place in enumerate(results):
        row(place, *(_percent(one[method][number]) for method in chosen.methods))


def _table(
    title: str,
    results: Mapping[str, Mapping[str, list[Run]]],
    columns: Iterable[str],
    cell: Callable[[list[Run]], str],
) -> None:
    """Print a table of places and columns."""
    head(title, 'right to, slip to', 'known', *columns)
    for place, by_method in results.items():
        known = int(next(iter(by_method.values()))[0].verdicts.known.sum())
        row(place, RIGHT[place], known, *(cell(by_method[name]) for name in columns))
    print()


def _best(variants: Sequence[Run], strict: bool = False) -> str:
    """Return the best recall, and the number of frames of a sequence that has it."""
    best = max(variants, key=lambda run: run.best(strict))
    length = re.search(r'(?:ds=|diagonal )(\d+)', best.text)
    told = f' ({length[1]})' if length and len(variants) > 1 else ''
    return _percent(best.best(strict)) + told


def _own(variants: Sequence[Run]) -> str:
    """Return the recall by the method's own decision, that of the first variant."""
    run = variants[0]
    false = int((run.verdicts.accepted & run.false()).sum())
    return _percent(run.recall(run.verdicts.accepted)) + (f' ({false:,})' if false else '')


def _slips(variants: Sequence[Run]) -> str:
    """Return how many answers the method's own decision accepts that are slips."""
    found = variants[0].verdicts
    return f'{int((found.accepted & found.slip).sum()):,}'


def _right(variants: Sequence[Run]) -> str:
    """Return how often the best answer is right, accepted or not: recall@1."""
    run = variants[0]
    return _percent(run.recall(run.verdicts.matched))


def _ms(variants: Sequence[Run]) -> str:
    return f'{variants[0].frame_ms:.0f}' if variants[0].frame_ms >= 0.5 else '< 1'


def _for_all(by_place: Sequence[Sequence[Run]]) -> Iterator[list[float]]:
    """Yield the recall on each place with one threshold for all, by variant and criterion."""
    for variant in zip(*by_place, strict=True):
        for criterion in variant[0].criteria:
            threshold = max(run.threshold(criterion) for run in variant)
            yield [run.recall(run.verdicts.above(criterion, threshold)) for run in variant]


def _percent(share: float) -> str:
    return f'{100 * share:.1f}'


if __name__ == '__main__':
    main()
