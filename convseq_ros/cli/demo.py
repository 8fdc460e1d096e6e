# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The main job from start to end: `convseq demo [--data FOLDER]`."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import statistics
import sys

from convseq_ros.cli.build_map import build
from convseq_ros.cli.demo_drives import drawn_drives, Drives, given_drives, make_empty, side_topics
from convseq_ros.cli.options import add_config, chosen_config
from convseq_ros.cli.processes import recognise_live
from convseq_ros.cli.replay import replay
from convseq_ros.core.encoding.first_stage import with_first_stage
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.evaluation.plots import demo_picture
from convseq_ros.onnx_model import open_model
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.results import row
from convseq_ros.simulation.light import LIGHTS
from convseq_ros.sources import open_annotated, open_source
import numpy as np
import numpy.typing as npt

_TOLERANCE = 2
_MARKER = '.convseq-demo'
_COMPARED = (
    'sequence_length', 'best_index', 'best_score', 'reference_index', 'reason', 'relative_yaw_rad',
)  # fmt: skip


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--data',
        type=Path,
        metavar='FOLDER',
        help='folder with two drives, query first by name (folders of images or recordings), and '
        'perhaps ground_truth.csv (query,reference); default: a street that is drawn',
    )
    parser.add_argument('--output', type=Path, default=Path('demo'), help='results (demo)')
    street = parser.add_argument_group('the drawn second drive')
    street.add_argument('--frames', type=int, default=120, help='images (120)')
    street.add_argument('--light', choices=LIGHTS, default='evening', help='(evening)')
    street.add_argument('--lane-offset', type=float, default=-0.2, metavar='M', help='(-0.2)')
    street.add_argument('--speed', type=float, default=10.0, metavar='M/S', help='(10)')
    add_config(parser)


def run(chosen: argparse.Namespace) -> int:
    """Map the first drive, recognise the second one live and offline, and show both."""
    folder, config = chosen.output, chosen_config(chosen)
    make_empty(folder, _MARKER)
    if chosen.data:
        drives = given_drives(chosen.data, config.reading)
    else:
        _say('drawing a street and driving along it twice')
        drives = drawn_drives(chosen, folder)
    map_path = folder / 'map.db'
    _say(f'building the map from {drives.reference}')
    odom = side_topics(drives.reference, config.reading).odom
    build(drives.reference, map_path, config, odom=odom)

    _say('replaying the second drive offline')
    beside = side_topics(drives.query, config.reading)
    model = open_model(config)
    known = with_first_stage(config, model)
    source = open_annotated(drives.query, '', *beside, reading=known.reading)
    recognizer = PlaceRecognizer(open_map(map_path, known.encoding), known, describe=model)
    offline, scores = [], np.full((len(source), len(recognizer.reference_map)), np.nan, np.float32)
    for match, duration_ms in replay(source, recognizer):
        written = row(match, duration_ms)
        offline.append({name: _text(value) for name, value in written.items()})
        if recognizer.buffer.row is not None:
            scores[match.query_index] = recognizer.buffer.row

    median_ms = statistics.median(float(each['duration_ms']) for each in offline)
    rate = min(4.0, 60.0 / median_ms)
    _say(f'playing it to the live node, at {rate:.2g} times its speed')
    position = {each['query_stamp_ns']: each['query_index'] for each in offline}
    live = [
        each | {'query_index': position[each['query_stamp_ns']]}
        for each in recognise_live(
            drives.query, len(source), map_path, folder, rate, config, **beside._asdict()
        )
    ]

    print(f'\n{drives.told}\n')
    print(_table(live, offline, drives.truth))
    picture = folder / 'demo.png'
    _draw(picture, drives, live, scores, config.reading)
    print(f'\nresults  {folder / "live.csv"}\npicture  {picture}')
    return 0


def _table(
    live: Sequence[dict[str, str]], offline: Sequence[dict[str, str]], truth: npt.NDArray[np.int64]
) -> str:
    same = sum(
        all(each[name] == offline[int(each['query_index'])][name] for name in _COMPARED)
        for each in live
    )
    columns = [_column(rows, truth, len(offline)) for rows in (live, offline)]
    lines = [f'{"":34}{"live node":>16}{"offline":>16}']
    lines += [f'{name:34}{columns[0][name]:>16}{columns[1][name]:>16}' for name in columns[0]]
    lines.append(f'{"same k, index and score":34}{f"{same} of {len(offline)}":>16}')
    return '\n'.join(lines)


def _column(
    rows: Sequence[dict[str, str]], truth: npt.NDArray[np.int64], sent: int
) -> dict[str, str]:
    matched = [each for each in rows if each['best_index']]
    accepted = [each for each in matched if each['reference_index']]
    lengths = [int(each['sequence_length']) for each in matched]
    durations = [float(each['duration_ms']) for each in rows]
    return {
        'frames': str(len(rows)),
        'frames dropped': str(sent - len(rows)),
        'matched (sequence long enough)': str(len(matched)),
        f'best match within +-{_TOLERANCE}': _share(matched, truth),
        'accepted': str(len(accepted)),
        f'accepted match within +-{_TOLERANCE}': _share(accepted, truth),
        'sequence length k': (
            f'{statistics.fmean(lengths):.1f} ({min(lengths)}-{max(lengths)})' if lengths else '-'
        ),
        'ms per frame (median)': f'{statistics.median(durations):.0f}' if durations else '-',
    }


def _share(rows: Sequence[dict[str, str]], truth: npt.NDArray[np.int64]) -> str:
    known = [each for each in rows if truth[int(each['query_index'])] >= 0]
    return f'{sum(_right(each, truth) for each in known)} of {len(known)}' if known else '-'


def _right(each: dict[str, str], truth: npt.NDArray[np.int64]) -> bool:
    return abs(int(each['best_index']) - int(truth[int(each['query_index'])])) <= _TOLERANCE


def _draw(
    path: Path,
    drives: Drives,
    live: Sequence[dict[str, str]],
    scores: npt.NDArray[np.float32],
    reading: ReadingConfig,
) -> None:
    found = np.full(len(scores), -1, np.int64)
    accepted = [each for each in live if each['reference_index']]
    for each in accepted:
        found[int(each['query_index'])] = int(each['reference_index'])
    shown = accepted[:: max(1, len(accepted) // 3)][:3]
    pairs = [(int(each['query_index']), int(each['reference_index'])) for each in shown]
    queries = _images(drives.query, [query for query, _ in pairs], reading)
    references = _images(drives.reference, [place for _, place in pairs], reading)
    pictures = [
        (queries[query], references[place], f'query {query}', f'reference {place}', right)
        for (query, place), right in zip(
            pairs, (_right(each, drives.truth) for each in shown), strict=True
        )
    ]
    demo_picture(path, pictures, scores, drives.truth, found, drives.told)


def _images(
    path: Path, wanted: Sequence[int], reading: ReadingConfig
) -> dict[int, npt.NDArray[np.uint8]]:
    return {
        index: frame.gray
        for index, frame in enumerate(open_source(path, reading=reading))
        if index in wanted and frame.gray is not None
    }


def _text(value: object) -> str:
    return '' if value is None else str(value)


def _say(what: str) -> None:
    print(f'{what} ...', file=sys.stderr)
