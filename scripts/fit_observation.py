# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print a fit of the log likelihood ratio of an observation (`CELLS`).

Usage: python scripts/fit_observation.py [--data FOLDER], a few minutes. Each drawn drive is
matched against the middle half of its map. With `--data`, the folder of the data sets, so is
corridor; laps and the other circuit are matched against the first lap.
The best verified place of each frame counts: right within 5 m (corridor: 5 frames), wrong beyond
15 (laps: as in laps.py). Right and wrong places have the same total weight, and so have all
drives. The shipped weights and half of the fit are printed too: consecutive frames are correlated.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import math
from pathlib import Path

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.core.decision.likelihood import CELLS
from convseq_ros.core.decision.observation import Observation
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.sources.folder import ImageFolder
from drawn_drives import drawn, Pair, PAIRS
from drives import options
import laps
import numpy as np

RIGHT, WRONG = 5.0, 15.0  # metres, or frames
STEPS = 30
NAMES = 'constant', 'strength', 'score'
Values = np.ndarray
Shown = list[tuple[Frame, float]]  # position: nan if unknown, inf if not in the map


@dataclass(frozen=True)
class Drive:
    """A map, a drive through it, and the distances of right and wrong answers."""

    name: str
    mapped: Shown
    queries: Shown
    config: Config
    right: float = RIGHT
    wrong: float = WRONG
    lap: float = 1e9  # length after which positions repeat


def of_drawn(pair: Pair) -> Drive:
    """Return a drawn drive."""
    (queries, there), (mapped, here) = drawn(pair, True), drawn(pair, False)
    first, last = kept_halves(len(mapped))['middle']
    kept = list(zip(mapped, here.tolist(), strict=True))[first:last]
    shown = list(zip(queries, there.tolist(), strict=True))
    return Drive(pair.name, kept, shown, make_config({'threads': 1}))


def of_corridor(folder: Path) -> Drive:
    """Return the drive through the corridor."""
    config = make_config({'keyframe_overlap': 1.0, 'threads': 1})
    mapped, queries = (
        [(frame, float(index)) for index, frame in enumerate(ImageFolder(folder / name))]
        for name in ('ref', 'query')
    )
    first, last = kept_halves(len(mapped))['middle']
    return Drive('corridor', mapped[first:last], queries, config)


def of_laps(folder: Path) -> Drive:
    """Return the drive after the first lap, with the first lap as map."""
    config = make_config({'threads': 1})
    truth = laps.read_truth(folder / 'ground_truth.csv')
    drive = list(ImageFolder(folder / 'drive'))
    where = [laps.place(truth, laps.number(frame)) for frame in drive]
    places = [math.nan if at is None else float(at) for at in where]
    shown = list(zip(drive, places, strict=True))
    count = sum(laps.number(frame) <= laps.FIRST_LAP for frame in drive)
    return Drive('laps', shown[:count], shown[count:], config, laps.RIGHT, laps.WRONG, laps.LAP)


def other_circuit(drive: Drive, folder: Path) -> Drive:
    """Return the drive on the other circuit, in the map of a drive."""
    other = [(frame, math.inf) for frame in ImageFolder(folder / 'other')]
    return Drive('laps, other', drive.mapped, other, drive.config, lap=drive.lap)


def watched(recognizer: PlaceRecognizer) -> list[Observation]:
    """Return a list to which every observation is appended."""
    seen = list[Observation]()
    observer = recognizer.decider._observer
    observe: Callable[..., Observation] = observer.observe

    def keep(*arguments: object) -> Observation:
        seen.append(observe(*arguments))
        return seen[-1]

    observer.observe = keep  # type: ignore[method-assign]
    return seen


def leads(drive: Drive) -> Iterator[tuple[float, float, bool]]:
    """Yield per keyframe both leads of the best verified place, and whether it is right."""
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    where = {frame.stamp_ns: at for frame, at in drive.mapped}
    recognizer = PlaceRecognizer(made, drive.config)
    seen = watched(recognizer)
    for frame, there in drive.queries:
        recognizer.process(frame)
        newest = seen.pop() if seen else None
        if not newest or not newest.leads or not newest.has_rivals:
            continue
        best = int(newest.leads.strength.argmax())
        away = abs(where[made.places[sorted(newest.verified)[best]].stamp_ns] - there)
        off = min(away, abs(drive.lap - away))
        if off <= drive.right or off > drive.wrong:
            yield newest.leads.strength[best], newest.leads.score[best], off <= drive.right


def weights_of(drives: list[Values]) -> Values:
    """Return the weights of rows: equal per drive, and equal for right and wrong."""
    right = np.concatenate([rows[:, 2] for rows in drives]) > 0
    counts = np.concatenate([np.full(len(rows), 1 / max(len(rows), 1)) for rows in drives])
    return np.where(right, counts / counts[right].sum(), counts / counts[~right].sum()) / 2


def fit(rows: Values, counts: Values) -> Values:
    """Return the weights of 1 and both leads in the log odds, by Newton's method."""
    features, right, weights = np.insert(rows[:, :2], 0, 1.0, axis=1), rows[:, 2], np.zeros(3)
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-features @ weights))
        gradient = features.T @ (counts * (right - chance))
        curvature = (features.T * (counts * chance * (1 - chance))) @ features
        weights += np.clip(np.linalg.solve(curvature + 1e-9 * np.eye(3), gradient), -1.0, 1.0)
    return weights


def log_ratios(rows: Values, weights: Values) -> Values:
    """Return the log likelihood ratios of rows."""
    return np.asarray(weights[0] + rows[:, :2] @ weights[1:])


def main() -> None:
    """Collect, fit, print and draw."""
    chosen = options(__doc__, data=None)
    drives = [of_drawn(pair) for pair in PAIRS]
    if chosen.data:
        drives += [of_corridor(chosen.data / 'corridor'), of_laps(chosen.data / 'laps')]
        drives.append(other_circuit(drives[-1], chosen.data / 'laps'))
    leads_of = {drive.name: np.array(list(leads(drive)), float).reshape(-1, 3) for drive in drives}
    every = [*leads_of.values()]
    rows, counts = np.concatenate(every), weights_of(every)
    shipped, fitted = np.array([getattr(CELLS, name) for name in NAMES]), fit(rows, counts)
    print('             ', *NAMES)
    for name, weights in (('fitted', fitted), ('shipped', shipped), ('half', fitted / 2)):
        print(f'{name:14}', *(f'{one:.2f}' for one in weights))
    print('above 0: drive, right, share by fit, as shipped; wrong, share by fit, as shipped')
    for name, values in {**leads_of, 'all': rows}.items():
        right = values[:, 2] > 0
        above = [log_ratios(values, weights) > 0 for weights in (fitted, shipped)]
        counts_of = [
            ' '.join(
                (f'{kind.sum()}', *(f'{one[kind].mean():.3f}' for one in above if kind.any()))
            )
            for kind in (right, ~right)
        ]
        print(f'{name}:', '; '.join(counts_of))


if __name__ == '__main__':
    main()
