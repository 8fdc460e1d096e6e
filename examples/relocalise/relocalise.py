# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Switched on at night in a mapped town, and carried away twice: `make demo-relocalise`."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
import shutil
import sys

from convseq_ros.cli.build_map import build
from convseq_ros.cli.demo_drives import make_empty
from convseq_ros.cli.processes import recognise_live
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import Shot
from scenes import draw_animation, draw_picture, Step
from town import record_day, record_night, STAYS

_MARKER = '.convseq-demo-relocalise'
_WRONG_M = 5.0


@dataclass(frozen=True, slots=True)
class Told:
    """What became of one stay."""

    lost_after: int | None  # frames after which it was no longer localised where it had been
    frames: int | None  # until it was localised here
    metres: float | None  # driven until then
    error_m: float | None  # from the recognised place to where the camera was, in the middle
    wrong: int  # frames localised further than 5 m from there, once lost or from the start on


def main() -> int:
    """Draw, map, run the node, tell and draw; return the exit code."""
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--output', type=Path, default=Path('demo-relocalise'))
    parser.add_argument('--images', type=Path, help='folder for copies of picture and animation')
    parser.add_argument('--rate', type=float, default=0.5, help='speed of playing (0.5)')
    parser.add_argument('--step', type=float, default=1.0, metavar='M', help='of the map (1)')
    parser.add_argument('--frames', type=int, default=32, help='of each stay (32)')
    chosen = parser.parse_args()
    try:
        _run(chosen, chosen.output.absolute())
    except (ConvseqError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    return 0


def _run(chosen: argparse.Namespace, folder: Path) -> None:
    make_empty(folder, _MARKER)
    print('drawing the town by day, mapping it, and drawing the night ...', file=sys.stderr)
    record_day(folder / 'day', chosen.step)
    build(folder / 'day', folder / 'map.db', odom='/odom')
    shots = record_night(folder / 'night', [replace(one, frames=chosen.frames) for one in STAYS])
    print(f'playing it to vpr_node, at {chosen.rate:g} times its speed ...', file=sys.stderr)
    beside = {'odom': '/odom', 'camera_info': '/camera/camera_info'}
    files = folder / 'night', len(shots), folder / 'map.db', folder
    rows = recognise_live(*files, chosen.rate, Config(), **beside)
    reference_map = open_map(folder / 'map.db')
    steps = _steps(rows, shots, reference_map)
    print(
        f'\nA drawn town, mapped by day: {len(reference_map)} places. At night, to the side and '
        f'turned, the robot is switched on\nand carried away twice, {len(steps)} frames in all.\n'
    )
    stays = range(len(STAYS))
    print(_table([_told([one for one in steps if one.stay == stay]) for stay in stays]))
    picture, animation = folder / 'relocalise.png', folder / 'relocalise.gif'
    draw_picture(picture, reference_map, steps)
    draw_animation(animation, reference_map, steps)
    if chosen.images:
        for path in (picture, animation):
            shutil.copyfile(path, chosen.images / path.name)
    print(f'\npicture    {picture}\nanimation  {animation}')


def _steps(
    rows: Sequence[dict[str, str]], shots: Sequence[tuple[int, Shot]], reference_map: ReferenceMap
) -> list[Step]:
    """Return what the node said of every frame beside the truth."""
    by_stamp = {row['query_stamp_ns']: row for row in rows}
    steps, place, before = [], None, 'lost'
    for stay, shot in shots:
        row = by_stamp[str(shot.stamp_ns)]
        state = row['localization']
        # Two that are not accepted may localise; what they agree on is the newest one's best.
        is_found = state != 'lost' and before != 'localised'
        if seen := row['reference_index'] or (row['best_index'] if is_found else ''):
            place = int(seen)
        before = state
        known = None if state == 'lost' else place
        pose = None if known is None else reference_map.places[known].pose
        steps.append(Step(stay, shot, state, known, pose))
    return steps


def _told(steps: Sequence[Step]) -> Told:
    """Return what became of a stay, from what was said of its frames."""
    left = [number for number, one in enumerate(steps) if one.state != 'localised']
    noticed = left[0] + 1 if steps[0].stay and left else None
    found = [n for n, one in enumerate(steps) if left and n > left[0] and one.state == 'localised']
    if not found:
        return Told(noticed, None, None, None, 0)
    first = steps[0].shot.pose.position
    errors = sorted(steps[number].error_m for number in found)
    return Told(
        noticed,
        found[0] + 1,
        math.dist(steps[found[0]].shot.pose.position, first),
        errors[len(errors) // 2],
        sum(error > _WRONG_M for error in errors),
    )


def _table(told: Sequence[Told]) -> str:
    head = ('', 'lost noticed', 'localised', 'driven', 'off, median', 'wrong')
    lines = [''.join(f'{name:>14}' for name in head)]
    for number, one in enumerate(told):
        name = 'carried away' if number else 'switched on'
        cells = (
            name,
            f'{one.lost_after} frames' if one.lost_after else 'never' if number else '',
            'never' if one.frames is None else f'{one.frames} frames',
            '' if one.metres is None else f'{one.metres:.1f} m',
            '' if one.error_m is None else f'{one.error_m:.2f} m',
            str(one.wrong),
        )
        lines.append(''.join(f'{cell:>14}' for cell in cells))
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
