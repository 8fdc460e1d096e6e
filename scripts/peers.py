# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the tables of docs/RESULTS.md: what we and what robots run today recognise.

Usage: python scripts/peers.py --data FOLDER [--sets corridor laps] [--methods convseq orb-bow],
some 20 minutes of a core. In methods, DATA is the folder.

By the open protocol: half of the map is removed in turn. Recall is right matches of all frames
whose place is in the map. *Own*: by the method's own decision, with its false matches. *Best*: at
the threshold that just keeps every false match of this very set out, by the criterion (and alpha)
with the highest recall, so that every method is favoured. The second table has the threshold that
does so on all sets together. ms are those of the processor for a frame. In laps a map of the first
lap is driven on: 40 of 840 places off is right, and up to 100 is not counted.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
import tempfile
import time

from convseq_ros.config import Config, make_config
from convseq_ros.evaluation.data_set import DataSet, open_data_set, Part, TruthSource
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.methods import make_method, parse_method
from convseq_ros.evaluation.protocols import ask, ONLINE, OPEN, Outcome
from convseq_ros.evaluation.scorecard import first_closures, judge, Verdicts
from convseq_ros.evaluation.truth import Truth
from convseq_ros.sources.folder import pictures_in
from drives import head, row
import laps
import numpy as np
import numpy.typing as npt

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
    'orb-bow+vocabulary=DATA/road_1/images': 'orb-bow, words of another set',  # a street in no set
    'sift-vlad': 'sift-vlad',
    'seqslam': 'SeqSLAM',
    'cohog': 'CoHOG',
    'hog': 'HOG',
}
ALPHAS = 0.3, 0.1, 0.2, 0.5  # DLoopDetector's own first


@dataclass(frozen=True, eq=False)
class Run:
    """What a method did on a set, with one of its variants."""

    verdicts: Verdicts
    halves: Sequence[str]
    frame_ms: float
    place_bytes: float

    def false(self, taken: npt.NDArray[np.bool_]) -> int:
        """Return how many of the answers taken are false."""
        return int((taken & self._wrong).sum())

    def threshold(self, criterion: str) -> float:
        """Return the highest value of a false answer."""
        wrong = self.verdicts.matched & self._wrong
        return float(self.verdicts.sure(criterion)[wrong].max(initial=-np.inf))

    @property
    def _wrong(self) -> npt.NDArray[np.bool_]:
        return ~self.verdicts.correct & ~self.verdicts.slip

    def recall(self, taken: npt.NDArray[np.bool_]) -> float:
        """Return the share of known frames that are taken and right."""
        return float((taken & self.verdicts.correct).sum() / self.verdicts.known.sum())

    def first(self, taken: npt.NDArray[np.bool_]) -> str:
        """Return how long each run waits for a right match."""
        waits = first_closures(replace(self.verdicts, accepted=taken), self.halves).values()
        if all(one is None for one in waits):
            return 'none'
        return ', '.join('none' if one is None else f'{one:.0f}' for one in waits)


@contextmanager
def laps_material(data: Path, config: Config) -> Iterator[Material]:
    """Yield the first lap as a map, and what follows as a query; unknown places are neutral."""
    truth = laps.read_truth(data / 'laps' / 'ground_truth.csv')
    with tempfile.TemporaryDirectory() as made:
        parts, places = [], []
        for name, first, last in (('rest', laps.FIRST_LAP + 1, 10**6), ('lap', 0, laps.FIRST_LAP)):
            folder = Path(made, name)
            folder.mkdir()
            every = pictures_in(data / 'laps' / 'drive')
            own = [one for one in every if first <= int(one.stem) <= last]
            for one in own:
                (folder / one.name).symlink_to(one.resolve())
            parts.append(Part(folder))
            places.append(np.array([laps.place(truth, int(one.stem)) for one in own], float))
        data_set = DataSet('laps', parts[0], TruthSource('none'), parts[1])
        material = open_material(data_set, config.encoding)
        query, reference = places
        off = np.abs((query[:, None] - reference + laps.LAP / 2) % laps.LAP - laps.LAP / 2)
        yield replace(material, truth=_Laps(off <= laps.RIGHT, 0, ~(off > laps.WRONG)))


@dataclass(frozen=True, slots=True)
class _Laps(Truth):
    near: npt.NDArray[np.bool_] | None = None  # (Q, R), what is not surely wrong

    @property
    def slip(self) -> npt.NDArray[np.bool_]:
        """What is neither right nor wrong."""
        return np.asarray(self.near & ~self.right)


def runs(material: Material, text: str, config: Config) -> list[Run]:
    """Return what a method does; of peers, with each alpha."""
    method = make_method(parse_method(text), config)
    protocol = ONLINE if material.data_set.online else OPEN
    if 'alpha' not in method.kind.options:
        return [_run(ask(material, method, protocol))]
    pairs, made = method.rows(material), []
    for alpha in ALPHAS:
        said = replace(pairs, detect=partial(pairs.detect, alpha=alpha))
        kind = replace(method.kind, rows=lambda *_, said=said: said)
        made.append(_run(ask(material, replace(method, kind=kind), protocol)))
    return made


def _run(outcome: Outcome) -> Run:
    pairs = outcome.pairs
    frame_ms = outcome.frame_ms or (pairs.encode_ms or 0.0) + (pairs.row_ms or 0.0)
    return Run(judge(outcome), outcome.halves, frame_ms, pairs.place_bytes or 0.0)


def criteria(run: Run) -> list[str]:
    """Return how sure a method can say to be."""
    return [one for one, values in run.verdicts.values.items() if not np.isnan(values).all()]


def main() -> None:
    """Measure, and print two tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--data', type=Path, required=True)
    parser.add_argument('--sets', nargs='*', default=SETS)
    parser.add_argument('--methods', nargs='*', default=[*NAMES])
    chosen = parser.parse_args()
    time.perf_counter = time.process_time  # what else the machine does takes no part
    config = make_config({'threads': 1})
    found: dict[str, list[list[Run]]] = {text: [] for text in chosen.methods}
    head('set', 'method', 'own, %', 'best, %', 'frames to the first right match, at best',
         'ms a frame', 'kB a place')  # fmt: skip
    for name in chosen.sets:
        with _opened(name, chosen.data, config) as material:
            for text in chosen.methods:
                some = runs(material, text.replace('DATA', str(chosen.data)), config)
                found[text].append(some)
                share, first = max(_options(some))
                best = f'**{_percent(share)}**' if text == 'convseq' else _percent(share)
                ms, kept_kb = some[0].frame_ms, some[0].place_bytes / 1e3
                costs = f'{ms:.0f}' if ms >= 0.5 else '< 1', f'{kept_kb:.1f}'
                shown = name if text == chosen.methods[0] else ''
                row(shown, NAMES.get(text, text), _own(some[0]), best, first, *costs)
    print()
    head('method', *chosen.sets)
    for text, by_set in found.items():
        one = max(_for_all(by_set), key=sum)
        row(NAMES.get(text, text), *map(_percent, one))


@contextmanager
def _opened(name: str, data: Path, config: Config) -> Iterator[Material]:
    if name == 'laps':
        with laps_material(data, config) as material:
            yield material
    else:
        yield open_material(open_data_set(name, data), config.encoding)


def _options(some: Sequence[Run]) -> Iterator[tuple[float, str]]:
    """Yield recall, and how long each run waits, at each criterion's best threshold."""
    for run in some:
        for criterion in criteria(run):
            taken = run.verdicts.taken(criterion, run.threshold(criterion))
            yield run.recall(taken), run.first(taken)


def _for_all(by_set: Sequence[Sequence[Run]]) -> Iterator[list[float]]:
    """Yield the recall on each set with one threshold for all, by variant and criterion."""
    for variant in zip(*by_set, strict=True):
        for criterion in criteria(variant[0]):
            threshold = max(run.threshold(criterion) for run in variant)
            yield [run.recall(run.verdicts.taken(criterion, threshold)) for run in variant]


def _own(run: Run) -> str:
    false = run.false(run.verdicts.accepted)
    return _percent(run.recall(run.verdicts.accepted)) + (f', {false:,} false' if false else '')


def _percent(share: float) -> str:
    return f'{100 * share:.1f}'


if __name__ == '__main__':
    main()
