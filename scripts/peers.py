# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the tables of docs/RESULTS.md: the recall of this package and of common methods.

Usage: python scripts/peers.py --data FOLDER [--sets corridor laps] [--methods convseq orb-bow],
more than an hour on one core. It needs scikit-image and pyhbst. DATA in a method stands for the
folder, WORDS for folders with images of all sets but the one measured.

The protocol is open: half of the map is removed in turn. Recall is the share of right matches
among the frames whose place is in the map. *Own* is the method's own decision, with its false
matches. *Best* is at the lowest threshold without a false match on this set, by the criterion (and
alpha and k) with the highest recall; this favours every method. The last table uses one
threshold without false matches on all sets. ms are CPU time per frame. In laps the map is the
first lap; a match within 40 of 840 places is right, and up to 100 is not counted.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
import tempfile
import time

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.cli.options import progress
from convseq_ros.config import Config, make_config
from convseq_ros.evaluation.data_set import DataSet, open_data_set, Part, TruthSource
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.methods import make_method, parse_method
from convseq_ros.evaluation.protocols import ONLINE, OPEN, Outcome, run_protocol
from convseq_ros.evaluation.scorecard import first_closures, judge, Verdicts
from convseq_ros.evaluation.truth import Truth
from convseq_ros.sources.folder import pictures_in
from drives import head, row
import laps
import numpy as np
import numpy.typing as npt
from other_sets import OtherSets

SETS = (
    'gardens_point_day_day',
    'street_night',
    'street_noise',
    'street_lane',
    'corridor',
    'rtabmap84',
    'laps',
)
NAMES = {
    'convseq': '**ours**',
    'orb-bow': 'orb-bow',
    'orb-bow vocabulary=DATA/road_1/images': 'orb-bow, words of another set',  # a street in no set
    'orb-bow vocabulary=WORDS levels=6 direct=4': (
        'orb-bow, 10^5 words of all other sets, direct index'
    ),
    'sift-vlad': 'sift-vlad',
    'sift-vlad rows=0': 'sift-vlad, images as they are',
    'hbst': 'hbst',
    'seqslam': 'SeqSLAM',
    'cohog': 'CoHOG',
    'hog': 'HOG',
}
TABLES = (
    'best, %',
    'own, % (false)',
    'frames to the first right match, at best',
    'ms a frame',
    'kB a place',
)
ALPHAS = 0.3, 0.1, 0.2, 0.5  # DLoopDetector's own first
CONSISTENT = 3, 1  # its own number of frames that agree, and that of its demo


@dataclass(frozen=True, eq=False)
class Run:
    """The results of a variant of a method on a set."""

    verdicts: Verdicts
    halves: Sequence[str]
    frame_ms: float
    place_bytes: float

    def false(self, accepted: npt.NDArray[np.bool_]) -> int:
        """Return the number of false answers among the accepted ones."""
        return int((accepted & self._wrong).sum())

    def threshold(self, criterion: str) -> float:
        """Return the highest value of a false answer."""
        wrong = self.verdicts.matched & self._wrong
        return float(self.verdicts.sure(criterion)[wrong].max(initial=-np.inf))

    @property
    def _wrong(self) -> npt.NDArray[np.bool_]:
        return ~self.verdicts.correct & ~self.verdicts.slip

    def recall(self, accepted: npt.NDArray[np.bool_]) -> float:
        """Return the share of known frames with a right accepted answer."""
        return float((accepted & self.verdicts.correct).sum() / self.verdicts.known.sum())

    def first(self, accepted: npt.NDArray[np.bool_]) -> str:
        """Return the number of frames to the first right match, per half, as text."""
        delays = first_closures(replace(self.verdicts, accepted=accepted), self.halves).values()
        if all(delay is None for delay in delays):
            return 'none'
        return ', '.join('none' if delay is None else f'{delay:.0f}' for delay in delays)


@contextmanager
def laps_material(data: Path, config: Config) -> Iterator[Material]:
    """Yield the first lap as map and the later laps as query; unknown places are neutral."""
    truth = laps.read_truth(data / 'laps' / 'ground_truth.csv')
    with tempfile.TemporaryDirectory() as root:
        parts, places = [], []
        for name, first, last in (('rest', laps.FIRST_LAP + 1, 10**6), ('lap', 0, laps.FIRST_LAP)):
            folder = Path(root, name)
            folder.mkdir()
            all_pictures = pictures_in(data / 'laps' / 'drive')
            files = [path for path in all_pictures if first <= int(path.stem) <= last]
            for path in files:
                (folder / path.name).symlink_to(path.resolve())
            parts.append(Part(folder))
            places.append(np.array([laps.place(truth, int(item.stem)) for item in files], float))
        data_set = DataSet('laps', parts[0], TruthSource('none'), parts[1])
        material = open_material(data_set, config.encoding)
        query, reference = places
        off = np.abs((query[:, None] - reference + laps.LAP / 2) % laps.LAP - laps.LAP / 2)
        yield replace(material, truth=_Laps(off <= laps.RIGHT, near=~(off > laps.WRONG)))


@dataclass(frozen=True, slots=True)
class _Laps(Truth):
    near: npt.NDArray[np.bool_] = field(kw_only=True)  # (Q, R), not clearly wrong

    @property
    def slip(self) -> npt.NDArray[np.bool_]:
        """Flags of the pairs that are neither right nor wrong."""
        return np.asarray(self.near & ~self.right)


def runs(material: Material, text: str, config: Config) -> list[Run]:
    """
    Return the runs of a method.

    A peer has one per alpha and number of frames that agree; hbst has one that geometry decides,
    and one that its scores decide.
    """
    method = make_method(parse_method(text), config)
    protocol = ONLINE if material.data_set.online else OPEN
    if 'rows' not in method.kind.options:
        return [_run(run_protocol(material, method, protocol))]
    pairs, variants = method.rows(material), []
    decisions: list[Callable[..., list[Detection]] | None] = [pairs.detect, None]
    if 'alpha' in method.kind.options:
        assert pairs.detect
        decisions = [
            partial(pairs.detect, alpha=alpha, consistent=frames)
            for alpha, frames in product(ALPHAS, CONSISTENT)
        ]
    for decision in decisions:
        changed = replace(pairs, detect=decision)
        kind = replace(method.kind, rows=lambda *_, changed=changed: changed)
        variants.append(_run(run_protocol(material, replace(method, kind=kind), protocol)))
    return variants


def _run(outcome: Outcome) -> Run:
    pairs = outcome.pairs
    frame_ms = outcome.frame_ms or (pairs.encode_ms or 0.0) + (pairs.row_ms or 0.0)
    return Run(judge(outcome), outcome.halves, frame_ms, pairs.place_bytes or 0.0)


def criteria(run: Run) -> list[str]:
    """Return the criteria for which a run has values."""
    return [name for name, values in run.verdicts.values.items() if not np.isnan(values).all()]


def main() -> None:
    """Measure, and print a table of methods and sets for each figure."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('--data', type=Path, required=True)
    parser.add_argument('--sets', nargs='*', default=SETS)
    parser.add_argument('--methods', nargs='*', default=[*NAMES])
    chosen = parser.parse_args()
    time.perf_counter = time.process_time  # so that other load does not count
    config = make_config({'threads': 1})
    results: dict[str, list[list[Run]]] = {text: [] for text in chosen.methods}
    tables: dict[str, dict[str, list[str]]] = {
        title: {text: [] for text in chosen.methods} for title in TABLES
    }
    words = OtherSets(chosen.data, SETS)
    for name in chosen.sets:
        with _opened(name, chosen.data, config) as material:
            for text in progress(chosen.methods, len(chosen.methods), name, 'methods'):
                asked = text.replace('DATA', str(chosen.data))
                if 'WORDS' in asked:
                    asked = asked.replace('WORDS', ','.join(map(str, words.folders(name))))
                variants = runs(material, asked, config)
                results[text].append(variants)
                for title, cell in zip(TABLES, _cells(variants), strict=True):
                    tables[title][text].append(cell)
    for title, cells in tables.items():
        _table(title, chosen.sets, cells)
    one = {text: max(_for_all(by_set), key=sum) for text, by_set in results.items()}
    _table(
        'one threshold for all sets, best %',
        chosen.sets,
        {text: [*map(_percent, shares)] for text, shares in one.items()},
    )


def _cells(variants: Sequence[Run]) -> tuple[str, ...]:
    """Return what TABLES tell of a method on a set; its own decision is of the first variant."""
    share, first = max(_options(variants))
    ms, kept_kb = variants[0].frame_ms, variants[0].place_bytes / 1e3
    return (
        _percent(share),
        _own(variants[0]),
        first,
        f'{ms:.0f}' if ms >= 0.5 else '< 1',
        f'{kept_kb:.1f}',
    )


def _table(title: str, sets: Sequence[str], rows: Mapping[str, Sequence[str]]) -> None:
    head(title, *sets)
    for text, cells in rows.items():
        row(NAMES.get(text, text), *cells)
    print()


@contextmanager
def _opened(name: str, data: Path, config: Config) -> Iterator[Material]:
    if name == 'laps':
        with laps_material(data, config) as material:
            yield material
    else:
        yield open_material(open_data_set(name, data), config.encoding)


def _options(variants: Sequence[Run]) -> Iterator[tuple[float, str]]:
    """Yield recall, and frames to the first right match, at each criterion's best threshold."""
    for run in variants:
        for criterion in criteria(run):
            accepted = run.verdicts.above(criterion, run.threshold(criterion))
            yield run.recall(accepted), run.first(accepted)


def _for_all(by_set: Sequence[Sequence[Run]]) -> Iterator[list[float]]:
    """Yield the recall on each set with one threshold for all, by variant and criterion."""
    for variant in zip(*by_set, strict=True):
        for criterion in criteria(variant[0]):
            threshold = max(run.threshold(criterion) for run in variant)
            yield [run.recall(run.verdicts.above(criterion, threshold)) for run in variant]


def _own(run: Run) -> str:
    false = run.false(run.verdicts.accepted)
    return _percent(run.recall(run.verdicts.accepted)) + (f' ({false:,})' if false else '')


def _percent(share: float) -> str:
    return f'{100 * share:.1f}'


if __name__ == '__main__':
    main()
