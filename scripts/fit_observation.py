# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fit the log likelihood ratio of an observation (`CELLS`, `KEYPOINTS`); print and draw it.

Usage: python scripts/fit_observation.py [--data FOLDER] [--output leads.png], some ten minutes.
Each drawn drive is matched against the middle half of its map. With `--data`, the folder of the
data sets, so is corridor; laps and the other circuit are matched against the first lap. The
strongest verified place of each frame counts: right within 5 m (corridor: 5 frames), wrong beyond
15 (laps: as in laps.py). Right and wrong places have the same total weight, and so have all
drives. Keypoints are asked in every frame. The fit is linear in the leads of the cells and of the
keypoints. Over the leads of keypoints, the shipped density of each expected lead is drawn (red: 0,
as elsewhere), and the log ratio at first in like light (black, right axis).
"""

from collections.abc import Callable, Iterator
import math
from pathlib import Path
from typing import Any

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.core.decision.expected_lead import ExpectedLead, KEYPOINTS, ratios_of
from convseq_ros.core.decision.likelihood import CELLS
from convseq_ros.core.decision.observation import Observation
from convseq_ros.evaluation.plots import new_figure, save
from drives import options
from known_drives import Drive, real, streets
import numpy as np

STEPS = 30
NAMES = 'constant', 'strength', 'score', 'keypoints'
ASKED = {'min_confidence': 1.0}  # never sure, so keypoints are always asked
Values = np.ndarray


def watched(recognizer: PlaceRecognizer) -> list[Observation]:
    """Return a list to which every observation is appended."""
    observations = list[Observation]()
    observer = recognizer.decider._observer
    observe: Callable[..., Observation] = observer.observe

    def keep(*arguments: object) -> Observation:
        observations.append(observe(*arguments))
        return observations[-1]

    observer.observe = keep
    return observations


def leads(drive: Drive) -> Iterator[tuple[float, float, float, bool]]:
    """Yield per keyframe the three leads of the strongest place, and whether it is right."""
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    where = {frame.stamp_ns: at for frame, at in drive.mapped}
    recognizer = PlaceRecognizer(made, drive.config)
    observations = watched(recognizer)
    for frame, there in drive.queries:
        recognizer.process(frame)
        newest = observations.pop() if observations else None
        if not newest or not newest.leads or not newest.has_rivals:
            continue
        best = int(newest.leads.strength.argmax())
        place = sorted(newest.verified)[best]
        if place not in newest.asked:
            continue
        off = drive.off(there, np.array([where[made.places[place].stamp_ns]]))[0]
        if off <= drive.right or off > drive.wrong:
            strength, score = newest.leads.strength[best], newest.leads.score[best]
            yield strength, score, newest.asked[place].lead, off <= drive.right


def weights_of(drives: list[Values]) -> Values:
    """Return the weights of rows: equal per drive, and equal for right and wrong."""
    right = np.concatenate([rows[:, 3] for rows in drives]) > 0
    counts = np.concatenate([np.full(len(rows), 1 / max(len(rows), 1)) for rows in drives])
    return np.where(right, counts / counts[right].sum(), counts / counts[~right].sum()) / 2


def fit(rows: Values, counts: Values) -> Values:
    """Return the weights of 1 and the three leads in the log odds, by Newton's method."""
    features, right, weights = np.insert(rows[:, :3], 0, 1.0, axis=1), rows[:, 3], np.zeros(4)
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-features @ weights))
        gradient = features.T @ (counts * (right - chance))
        curvature = (features.T * (counts * chance * (1 - chance))) @ features
        weights += np.clip(np.linalg.solve(curvature + 1e-9 * np.eye(4), gradient), -1.0, 1.0)
    return weights


def draw(leads_of: dict[str, Values], output: Path) -> None:
    """Draw the leads of right and of wrong places of each drive, and the shipped ratio."""
    shown = new_figure(9.0, 1.3 * len(leads_of))
    for row, (name, values) in enumerate(leads_of.items()):
        right = values[:, 3] > 0
        for column, title in enumerate(('strength', 'pair score', 'keypoints')):
            axes = shown.add_subplot(len(leads_of), 3, 3 * row + column + 1)
            bins = np.linspace(-6, 16, 45)
            for kind, colour in ((right, 'tab:green'), (~right, 'tab:red')):
                if kind.any():
                    axes.hist(values[kind, column], bins, density=True, alpha=0.5, color=colour)
            if not column:
                axes.set_ylabel(name, fontsize=7)
            axes.set_title(title if not row else '', fontsize=8)
            axes.tick_params(labelsize=6)
        draw_shipped(axes, bins)
    shown.tight_layout()
    save(shown, output)


def draw_shipped(axes: Any, leads: Values) -> None:
    """Draw the shipped densities of the keypoints' leads, and their log ratio in like light."""
    for expected in KEYPOINTS.expected:
        density = np.exp(-(((leads - expected) / KEYPOINTS.sigma) ** 2) / 2)
        density /= KEYPOINTS.sigma * math.sqrt(2 * math.pi)
        axes.plot(leads, density, color='tab:green' if expected else 'tab:red', linewidth=0.8)
    in_like_light = ExpectedLead(lambda places, _: np.zeros(len(places)))
    shares = in_like_light.entering(np.zeros(1, np.int64), 0)[:, 0]
    ratios = np.array([shares @ ratios_of(lead) for lead in leads])
    beside = axes.twinx()
    beside.plot(leads, np.log(ratios), color='black', linewidth=0.8)
    beside.tick_params(labelsize=6)


def expected_leads(values: Values) -> tuple[float, float, float]:
    """Return the means of the keypoints' leads of right and wrong places, and their sigma."""
    right = values[:, 3] > 0
    kinds = [values[kind, 2] for kind in (right, ~right) if kind.any()]
    sigma = math.sqrt(np.average([kind.var() for kind in kinds]))
    of = [float(values[kind, 2].mean()) if kind.any() else math.nan for kind in (right, ~right)]
    return of[0], of[1], sigma


def main() -> None:
    """Collect, fit, print and draw."""
    chosen = options(__doc__, data=None, output=Path('leads.png'))
    makers = [*streets(ASKED), *(real(chosen.data, ASKED) if chosen.data else ())]
    drives = (make() for make in makers)
    found = {drive.name: np.array(list(leads(drive)), float).reshape(-1, 4) for drive in drives}
    leads_of = {name: values for name, values in found.items() if len(values)}
    every = [*leads_of.values()]
    rows, counts = np.concatenate(every), weights_of(every)
    print('weights      ', *NAMES)
    print('fitted       ', *(f'{one:.2f}' for one in fit(rows, counts)))
    cells = CELLS.constant, CELLS.per_scale, CELLS.per_scale
    print('shipped cells', *(f'{one:.2f}' for one in cells))
    print("keypoints' leads: mean of right places, of wrong ones, sigma")
    print(f'shipped: {KEYPOINTS.by_day} in the same light, less in other; 0; {KEYPOINTS.sigma}')
    for name, values in leads_of.items():
        print(f'{name}:', *(f'{one:.1f}' for one in expected_leads(values)))
    draw(leads_of, chosen.output)


if __name__ == '__main__':
    main()
