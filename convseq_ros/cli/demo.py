# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The main task from start to end, on a drawn street: `convseq demo`."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import shutil
import statistics
import sys

from convseq_ros.app.cameras import Cameras
from convseq_ros.cli.build_map import build
from convseq_ros.cli.demo_slam import run_slam
from convseq_ros.cli.processes import CAMERA_INFO, ODOM, recognise_live
from convseq_ros.cli.replay import opened, replay
from convseq_ros.cli.replay_report import ReplayReport
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.errors import ConvseqError
from convseq_ros.io.output_file import make_folder
from convseq_ros.io.results import read_results
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources import open_annotated
import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.int64]
Rows = Sequence[dict[str, str]]  # of a result table
_MARKER = '.convseq-demo'
_TOLERANCE = 2  # of a match, in references
_COMPARED = (
    'sequence_length', 'best_index', 'best_score', 'reference_index', 'reason', 'relative_yaw_rad',
)  # fmt: skip
_CAPTION = 'A drawn street: mapped by day, driven again in the evening, 1.3 m to the side.'


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--output', type=Path, default=Path('demo'), help='results (demo)')
    help_ = 'correct a drive through a town with pose_graph_node instead; needs gtsam'
    parser.add_argument('--slam', action='store_true', help=help_)
    parser.add_argument('--frames', type=int, default=120, help='images of the second drive (120)')


def run(chosen: argparse.Namespace) -> int:
    """Map the first drive, recognise the second one live and offline, and compare both."""
    folder = chosen.output
    make_empty(folder, _MARKER)
    if chosen.slam:
        run_slam(folder.absolute())
        return 0
    _say('drawing a street and driving along it twice')
    truth = _draw_drives(chosen.frames, folder)
    map_path = folder / 'map.db'
    _say('building the map of the first drive')
    build(folder / 'first', map_path, odom=ODOM)

    _say('replaying the second drive offline')
    source = open_annotated(folder / 'second', '', ODOM, CAMERA_INFO)
    cameras, report = Cameras(open_map(map_path), Config()), ReplayReport()
    with opened(folder / 'offline.csv') as write:
        frames = len([*replay(source, cameras, write, report.add)])
    offline = read_results(folder / 'offline.csv')

    median_ms = statistics.median(float(row['duration_ms']) for row in offline)
    rate = min(4.0, 60.0 / median_ms)
    _say(f'sending it to the live node, at {rate:.2g} times its speed')
    position = {row['query_stamp_ns']: row['query_index'] for row in offline}
    live = [
        row | {'query_index': position[row['query_stamp_ns']]}
        for row in recognise_live(folder / 'second', frames, map_path, folder, rate)
    ]

    print(f'\n{_CAPTION}\n')
    print(_table(live, offline, truth))
    report.write(folder / 'demo.html', _CAPTION, cameras.first)
    print(f'\nresults  {folder / "live.csv"}\npage     {folder / "demo.html"}')
    return 0


def make_empty(folder: Path, marker: str) -> None:
    """Make an empty folder; ConvseqError if it has content, but no marker of an earlier demo."""
    make_folder(folder)
    mark = folder / marker
    if any(folder.iterdir()) and not mark.is_file():
        raise ConvseqError(f'{folder}: exists and is not of an earlier demo; choose another')
    shutil.rmtree(folder, ignore_errors=True)
    make_folder(folder)
    mark.touch()


def _draw_drives(frames: int, folder: Path) -> Numbers:
    """Write recordings of two drives; return the right reference of each frame, (Q,)."""
    first = Drive(num_frames=frames + 10)
    second = Drive(
        num_frames=frames,
        start_m=3.4,
        seed=5,
        lane_offset_m=-0.2,
        light='evening',
        start_ns=first.start_ns + 3600 * 10**9,
    )
    street = Street(length_m=frames + 60.0, seed=7)
    for name, drive in (('first', first), ('second', second)):
        write_recording(folder / name, draw(street, drive), info_topic=CAMERA_INFO)
    # The first drive takes an image every metre, from 0 on.
    return np.array([round(second.distance_m(index)) for index in range(frames)])


def _table(live: Rows, offline: Rows, truth: Numbers) -> str:
    same = sum(
        all(row[name] == offline[int(row['query_index'])][name] for name in _COMPARED)
        for row in live
    )
    columns = [_column(rows, truth) for rows in (live, offline)]
    lines = [f'{"":34}{"live node":>16}{"offline":>16}']
    lines += [f'{name:34}{columns[0][name]:>16}{columns[1][name]:>16}' for name in columns[0]]
    lines.append(f'{"same k, index and score":34}{f"{same} of {len(offline)}":>16}')
    return '\n'.join(lines)


def _column(rows: Rows, truth: Numbers) -> dict[str, str]:
    matched = [row for row in rows if row['best_index']]
    accepted = [row for row in matched if row['reference_index']]
    lengths = [int(row['sequence_length']) for row in matched]
    durations = [float(row['duration_ms']) for row in rows]
    return {
        'frames': str(len(rows)),
        'frames dropped': str(len(truth) - len(rows)),
        'with a best match': str(len(matched)),
        f'best match within +-{_TOLERANCE}': _share(matched, truth),
        'accepted': str(len(accepted)),
        f'accepted match within +-{_TOLERANCE}': _share(accepted, truth),
        'k: frames with the evidence': (
            f'{statistics.fmean(lengths):.1f} ({min(lengths)}-{max(lengths)})' if lengths else '-'
        ),
        'ms per frame (median)': f'{statistics.median(durations):.0f}' if durations else '-',
    }


def _share(rows: Rows, truth: Numbers) -> str:
    return f'{sum(_right(row, truth) for row in rows)} of {len(rows)}' if rows else '-'


def _right(row: dict[str, str], truth: Numbers) -> bool:
    return abs(int(row['best_index']) - int(truth[int(row['query_index'])])) <= _TOLERANCE


def _say(what: str) -> None:
    print(f'{what} ...', file=sys.stderr)
