# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Replay drives with other constants of the decision, and print what becomes of them.

Usage: python scripts/fit_decision.py [--data FOLDER] [--real FOLDER]
[--change NAME=VALUE,... ...] [--curve NAME ...] [--processes 2]. --data has the sets of the
benchmark, --real those of real_drives.py. On two cores it takes a quarter of an hour to encode the
drives, and a minute for each change. A name is RECORD.name, such as BELIEF.entering. Each change
is tried by itself. A curve tries a constant at 0.5, 0.7, 0.85, 1.2, 1.4 and 2 times its value, and
prints which value is chosen with each place left out in turn; `--curve all` those of all constants
that decide, in a night. Of several curves, the values chosen without a place are then tried
together, and this place is scored with them.

A match is right within the right distance, and false beyond the wrong one; between them it counts
as neither. A drive scores (right - 10 false) / keyframes whose place is in the map, or of all
keyframes, if none is. A place scores the mean of its drives, and has one vote: the score is the
mean over places. The straight, of which nothing returns, has none. Beside it stands the mean of
log(p + 0.001), where p is the probability that the belief gives to the truth.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
import math
from typing import Any, NamedTuple

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.core.decision import (
    belief,
    budget,
    comparison,
    covisibility,
    expected_lead,
    likelihood,
    motion,
)
from convseq_ros.core.gate.gate import Verdict
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.matcher import Matcher
from convseq_ros.core.similarity.scorer import Features
from convseq_ros.core.types import Descriptor
from drives import head, options, progress, row
from known_drives import benchmark, Drive, Make
import numpy as np
from real_drives import in_other_light

RECORDS: dict[str, Any] = {
    'CELLS': likelihood.CELLS, 'COPIES': likelihood.COPIES, 'KEYPOINTS': expected_lead.KEYPOINTS,
    'COMPARED': comparison.COMPARED, 'COVISIBLE': covisibility.COVISIBLE,
    'BELIEF': belief.BELIEF,
    'MOTION': motion.MOTION, 'LIGHT': expected_lead.LIGHT, 'BUDGET': budget.BUDGET,
}  # fmt: skip
FLOOR = 0.001  # of a probability: an answer cannot be more wrong than this
ELSEWHERE = 0.5  # overlap of the views below which a scene is seen from elsewhere
COST = 10  # missed matches that a false one costs
FACTORS = 0.5, 0.7, 0.85, 1.2, 1.4, 2.0  # of a curve
Changes = dict[str, Any]
Counts = Counter[str]


class KeptMatcher(Matcher):
    """A matcher that keeps what it computed, by the stamps of frame and place."""

    kept: dict[tuple[str, int, int], Any]
    now = 0  # stamp of the newest frame

    def extract(self, descriptor: Descriptor) -> Features | None:
        features = super().extract(descriptor)
        if features is not None:
            self._stamps[id(features)] = self.now, features
        return features

    def reset(self) -> None:
        super().reset()
        self._stamps = dict[int, tuple[int, Features]]()

    def _known(
        self, kind: str, query: Features, indices: Iterable[int], compute: Callable[..., Any]
    ) -> list[Any]:
        asked, (stamp, _) = [int(index) for index in indices], self._stamps[id(query)]
        keys = {index: (kind, stamp, self._map.places[index].stamp_ns) for index in asked}
        missing = [index for index in keys if keys[index] not in self.kept]
        if missing:
            found = compute(missing)
            self.kept.update((keys[index], one) for index, one in zip(missing, found, strict=True))
        return [self.kept[keys[index]] for index in asked]

    def scores_of(self, requests: Any) -> Any:
        def rows(query: Features, indices: Any) -> Any:
            compute = super(KeptMatcher, self).scores_of
            found = self._known(
                'pair', query, indices, lambda few: compute([(query, np.array(few))])[0].tolist()
            )
            return np.array(found, np.float32)

        return [rows(*request) for request in requests]

    def rough_scores(self, query: Features, indices: Any) -> Any:
        if query.rough is None or self._rough is None:
            return None
        compute = super().rough_scores
        found = self._known('rough', query, indices, lambda few: compute(query, np.array(few)))
        return np.array(found, np.float32)

    def verified(self, query: Features, indices: Any) -> Any:
        if query.packed is None:
            return {}
        compute = super().verified

        def several(few: list[int]) -> list[Any]:
            found = compute(query, few)
            return [found[index] for index in few]

        found = self._known('verified', query, indices, several)
        return dict(zip(map(int, indices), found, strict=True))


class Encoded(NamedTuple):
    """A drive whose keyframes are encoded, and what was compared."""

    drive: Drive
    made: ReferenceMap
    verdicts: dict[int, Verdict]  # of the keyframes, by stamp: they do not depend on the decision
    kept: dict[tuple[str, int, int], Any]


PREPARED: list[Encoded] = []  # of this process


def encoded(drive: Drive) -> Encoded:
    """Return a drive with its keyframes."""
    progress(f'encoding {drive.name}')
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    one = Encoded(drive, made, {}, {})
    recognizer, matcher = keeping(one, made)
    check = recognizer.gate.check

    def keep(stamp_ns: int, *rest: Any) -> Verdict:
        verdict = check(stamp_ns, *rest)
        if verdict.reason is None:
            one.verdicts[stamp_ns] = verdict
        return verdict

    recognizer.gate.check = keep
    for frame, _ in drive.queries:
        matcher.now = frame.stamp_ns
        recognizer.process(frame)
    return one


def keeping(one: Encoded, made: ReferenceMap) -> tuple[PlaceRecognizer, KeptMatcher]:
    """Return a recogniser whose matcher and witness keep what they compute."""
    config = one.drive.config
    matcher = KeptMatcher(made, config.matching, config.encoding.saliency_threshold, 500)
    matcher.kept = one.kept
    matcher.reset()
    recognizer = PlaceRecognizer(made, config, matcher=matcher)
    keep_blocks(recognizer, matcher, made)
    return recognizer, matcher


def prepare(makers: list[Make]) -> None:
    """Encode the drives of this process."""
    PREPARED.extend(encoded(make()) for make in makers)


def replay(one: Encoded) -> Counts:
    """Return what becomes of a drive: counts, and the sum of the logarithms."""
    drive, made, counts = one.drive, one.made, Counts()
    if drive.config.online.grows:  # the map has grown, so begin with an empty one
        made = build_map([], None, drive.config)
    recognizer, matcher = keeping(one, made)
    recognizer.gate.check = lambda stamp_ns, *_: one.verdicts[stamp_ns]
    queries = {frame.stamp_ns: here for frame, here in drive.queries}
    mapped = {frame.stamp_ns: here for frame, here in drive.mapped} or queries
    begun = None
    keyframes = [frame for frame, _ in drive.queries if frame.stamp_ns in one.verdicts]
    for number, frame in enumerate(keyframes):
        matcher.now = frame.stamp_ns
        match, here = recognizer.process(frame), queries[frame.stamp_ns]
        places = made.places[: recognizer.mapping.usable]
        off = drive.off(here, np.array([mapped[one.stamp_ns] for one in places]))
        is_known = bool((off <= drive.right).any())
        counts['known'] += is_known
        counts['asked'] += 1
        if is_known and begun is None:
            begun = number
        if (found := probability(recognizer, off, drive)) is not None:
            counts['logs'] += math.log(found + FLOOR)  # type: ignore[assignment]
            counts['told'] += 1
        if match.candidates and is_known:
            counts['best'] += bool(off[match.candidates[0].reference_index] <= drive.right)
        if match.accepted:
            away = off[match.accepted.reference_index]
            counts['right'] += bool(away <= drive.right)
            counts['false'] += bool(away > drive.wrong)
            counts['off'] += bool(away > drive.right)
            if match.overlap is not None and match.overlap < ELSEWHERE:
                counts['right elsewhere'] += bool(away <= drive.right)
                counts['off elsewhere'] += bool(away > drive.right)
            if match.confidence is not None and match.confidence >= 0.99:
                counts['sure'] += 1
                counts['sure false'] += bool(away > drive.wrong)
            if away <= drive.right and begun is not None and 'first' not in counts:
                counts['first'] = number - begun
    return counts


def keep_blocks(recognizer: PlaceRecognizer, matcher: KeptMatcher, made: ReferenceMap) -> None:
    """Let the witness keep in how many blocks keypoints agree."""
    witness = recognizer.decider._observer._witness
    blocks = witness.blocks

    def known(query: Any, place: int, *rest: Any) -> int:
        key = 'blocks', matcher.now, made.places[place].stamp_ns
        if key not in matcher.kept:
            matcher.kept[key] = blocks(query, place, *rest)
        return matcher.kept[key]

    witness.blocks = known


def probability(recognizer: PlaceRecognizer, off: np.ndarray, drive: Drive) -> float | None:
    """Return the probability of the truth; None if it is unknown. `off` (n,) are distances."""
    believed, known = recognizer.decider._belief, off[~np.isnan(off)]
    if len(off) and not len(known):
        return None
    if len(known) and known.min() <= drive.right:
        return float(believed.mass[off[believed.places] <= drive.right].sum())
    is_elsewhere = not len(known) or known.min() > drive.wrong
    return believed.elsewhere if is_elsewhere else None


def results(changes: Changes) -> dict[str, tuple[str, Counts]]:
    """Return the places and counts of the drives of this process, with changed constants."""
    with changed(changes):
        return {one.drive.name: (one.drive.place, replay(one)) for one in PREPARED}


def of(name: str) -> Any:
    """Return the value of a constant."""
    record, _, field = name.partition('.')
    return getattr(RECORDS[record], field)


@contextmanager
def changed(changes: Changes) -> Iterator[None]:
    """Change constants of this process."""
    before = {name: of(name) for name in changes}

    def set_to(values: Changes) -> None:
        for name, value in values.items():
            record, _, field = name.partition('.')
            object.__setattr__(RECORDS[record], field, value)

    set_to(changes)
    try:
        yield
    finally:
        set_to(before)


class Drives:
    """Drives that are shared by processes."""

    def __init__(self, makers: list[Make], processes: int) -> None:
        self._pools = [
            ProcessPoolExecutor(1, initializer=prepare, initargs=(makers[number::processes],))
            for number in range(processes)
        ]

    def replayed(self, changes: Changes) -> dict[str, tuple[str, Counts]]:
        """Replay all drives; return their places and counts, by name."""
        waiting = [pool.submit(results, changes) for pool in self._pools]
        return {name: found for one in waiting for name, found in one.result().items()}


def by_place(found: Mapping[str, tuple[str, Counts]]) -> dict[str, float]:
    """Return the score of each place."""
    scores = dict[str, list[float]]()
    for place, counts in found.values():
        if place:
            asked = counts['known'] or counts['asked']
            gained = counts['right'] - COST * counts['false']
            scores.setdefault(place, []).append(gained / asked)
    return {place: float(np.mean(some)) for place, some in sorted(scores.items())}


def mean(scores: Mapping[str, float], but: str = '') -> float:
    """Return the mean score of places, one of them left out."""
    return float(np.mean([score for place, score in scores.items() if place != but] or [0.0]))


def tell(name: str, found: Mapping[str, tuple[str, Counts]]) -> dict[str, float]:
    """Print a row; return the score of each place."""
    scores = by_place(found)
    of_all = [counts for place, counts in found.values() if place]
    right, false = (sum(one[kind] for one in of_all) for kind in ('right', 'false'))
    logs = np.mean([counts['logs'] / max(1, counts['told']) for counts in of_all])
    each = '; '.join(
        f'{drive} {counts["right"]}' + (f'+{counts["false"]}' if counts['false'] else '')
        for drive, (_, counts) in found.items()
    )
    row(name, f'{mean(scores):.4f}', f'{logs:.3f}', right, false, each)
    return scores


def details(found: Mapping[str, tuple[str, Counts]]) -> None:
    """Print a row for each drive, and one for each place."""
    names = {'asked': 'keyframes', 'best': 'best is right'}
    kinds = 'asked', 'known', 'best', 'right', 'false'
    head('drive', *(names.get(kind, kind) for kind in kinds), 'first after', 'mean log')
    for drive, (_, one) in found.items():
        logs = f'{one["logs"] / max(1, one["told"]):.2f}'
        first = one['first'] if 'first' in one else '-'
        row(drive, *(one[kind] for kind in kinds), first, logs)
    print()
    head('place', 'score')
    for place, score in by_place(found).items():
        row(place, f'{score:.3f}')
    of_all = [counts for place, counts in found.values() if place]
    sure, false = (sum(one[kind] for one in of_all) for kind in ('sure', 'sure false'))
    print(f'\nOf {sure} matches with a confidence of .99 or more, {false} are false.')
    for kind, told in (('right', 'right matches'), ('off', 'others')):
        seen = [sum(counts[name] for counts in of_all) for name in (kind, f'{kind} elsewhere')]
        print(f'Of {seen[0]} {told}, {seen[1]} have an overlap below {ELSEWHERE}.')
    print()


def deciding() -> list[str]:
    """Return the names of all constants that are numbers, but for budgets of work."""
    records = {record: one for record, one in RECORDS.items() if record != 'BUDGET'}
    names = [f'{record}.{field}' for record in records for field in records[record].__slots__]
    return [name for name in names if isinstance(of(name), int | float)]


def curve(drives: Drives, name: str, shipped: Mapping[str, float]) -> dict[str, Any]:
    """Print what becomes of the drives along a constant; return its choice without each place."""
    scores = {of(name): shipped}
    for factor in FACTORS:
        value = of(name) * factor
        value = round(value) if isinstance(of(name), int) else value
        if value not in scores:
            scores[value] = tell(f'{name}={value:.4g}', drives.replayed({name: value}))
    chosen = {
        place: max(scores, key=lambda value: mean(scores[value], place)) for place in shipped
    }
    for value in sorted(set(chosen.values())):
        left_out = [place for place in chosen if chosen[place] == value]
        print(f'{name}={value:.4g} is chosen without {", ".join(left_out)}')
    held_out = np.mean([scores[value][place] for place, value in chosen.items()])
    print(f'Places left out score {held_out:.4f}, with the shipped value {mean(shipped):.4f}.\n')
    return chosen


def together(
    drives: Drives, chosen: Mapping[str, Mapping[str, Any]], shipped: Mapping[str, float]
) -> None:
    """Print the score of each place with all that is chosen without it, by constant and place."""
    scores, left_out = dict[str, Mapping[str, float]](), dict[str, float]()
    for place in shipped:
        changes = {name: values[place] for name, values in chosen.items()}
        told = ','.join(f'{name}={value:.4g}' for name, value in changes.items())
        if told not in scores:
            scores[told] = tell(told, drives.replayed(changes))
        left_out[place] = scores[told][place]
        print(f'Without {place} all of this is chosen: it scores {left_out[place]:.4f}.')
    print(f'Places left out score {mean(left_out):.4f}, as shipped {mean(shipped):.4f}.\n')


def main() -> None:
    """Encode, replay, and print tables."""
    chosen = options(__doc__, data=None, real=None, change=[''], curve=[''], processes=2)
    makers = [
        *(in_other_light(chosen.real).values() if chosen.real else ()),
        *(benchmark(chosen.data) if chosen.data else ()),
    ]
    drives = Drives(makers, chosen.processes)
    found = drives.replayed({})
    details(found)
    head('changed', 'score', 'mean log', 'right', 'false', 'right+false of each drive')
    shipped = tell('shipped', found)
    for words in filter(None, chosen.change):
        pairs = (word.split('=') for word in words.split(','))
        tell(words, drives.replayed({name: float(value) for name, value in pairs}))
    names = deciding() if 'all' in chosen.curve else [*filter(None, chosen.curve)]
    curves = {name: curve(drives, name, shipped) for name in names}
    if len(curves) > 1:
        together(drives, curves, shipped)


if __name__ == '__main__':
    main()
