# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognise a recording in a map, without ROS: `convseq replay RECORDING --map MAP`."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from importlib import import_module
import json
from pathlib import Path
import statistics
import time
from typing import Any

from convseq_ros.app.cameras import Cameras
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.cli.options import (
    add_config,
    add_images,
    chosen_config,
    chosen_images,
    note,
    progress,
    say,
    tells_what_is_kept,
    warn,
)
from convseq_ros.cli.outputs import add_output
from convseq_ros.cli.processes import need_ros
from convseq_ros.cli.replay_report import ReplayReport
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match, Pose, Reason
from convseq_ros.errors import MapError, printable
from convseq_ros.io.output_file import ANSWERS, PAGE
from convseq_ros.io.regular_file import write_lines
from convseq_ros.io.results import ResultWriter
from convseq_ros.models.onnx_model import open_model
from convseq_ros.pose_graph.lines import tum
from convseq_ros.sources import in_order, open_each_camera, Source

Listener = Callable[[Frame, Match, PlaceRecognizer, float], None]


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('recording', type=Path, help='recording or folder of images')
    help_ = 'reference map; with --mode online it is made if there is none, and grows'
    parser.add_argument('--map', type=Path, required=True, help=help_)
    help_ = (
        'also write the poses of accepted frames in the map, in the format of TUM, as evo reads'
    )
    add_output(parser, '--tum', metavar='FILE', help=help_)
    help_ = 'also write a page of what was matched, with pictures, for a browser'
    add_output(parser, '--report', kinds=PAGE, metavar='PAGE.html', help=help_)
    # A table of options reads better in few lines.
    # fmt: off
    add_output(parser, '--output', default=Path('result.csv'), kinds=ANSWERS, help='table to '
        'write (result.csv); FILE.mcap gets what the node would publish (needs ROS)')
    # fmt: on
    add_images(parser)
    parser.add_argument('--json', action='store_true', help='print the summary as JSON')
    add_config(parser)


def run(chosen: argparse.Namespace) -> int:
    """Replay, write the table, and print a summary."""
    config, sources = chosen_config(chosen), chosen.topic.split()
    with tells_what_is_kept(chosen.map):
        pipeline = Pipeline(chosen.map, config, sources=sources, describe=open_model(config))
        for line in pipeline.ignored:
            warn(line)
        with closing(pipeline):
            pipeline.warm_up()
            summary = _replayed(chosen, pipeline)
    if chosen.json:
        about = {'output': str(chosen.output), 'added': pipeline.added, 'slow': pipeline.slow}
        print(json.dumps(about | summary))
    else:
        if pipeline.is_growing:
            kept = pipeline.owner.committed
            say(f'{chosen.map}: {pipeline.added} references added, {kept} in all')
        say(f'{chosen.output}: {in_words(summary, pipeline.slow)}')
    return 0


def _replayed(chosen: argparse.Namespace, pipeline: Pipeline) -> dict[str, Any]:
    """Replay a recording in a map, save new places, and return a summary."""
    cameras, first, name = pipeline.cameras, pipeline.recognizer, chosen.map
    reading = first.config.reading
    source = in_order(open_each_camera(chosen.recording, reading=reading, **chosen_images(chosen)))
    spacing_m = first.reference_map.keyframes.keyframe_distance_m
    if spacing_m and not (chosen.odom or chosen.poses):
        warn(
            f'{name}: has a place every {spacing_m:g} m; without --odom or --poses every frame is '
            'matched with it'
        )
    matches, durations = [], []
    poses = list[tuple[int, Pose]]()
    report = ReplayReport() if chosen.report else None
    with opened(chosen.output) as write:
        listeners = [write, report.add] if report else [write]
        for match, duration_ms in replay(source, cameras, *listeners):
            if match.pose:
                poses.append((match.query_stamp_ns, match.pose.pose))
            matches.append(match)
            durations.append(duration_ms)
            _save(pipeline)
    if report:
        title = printable(f'{chosen.recording.name} in {name.name}')
        report.write(chosen.report, title, first)
    for line in cameras.notes:
        note(line)
    for warning in [*source.warnings, *cameras.problems]:
        warn(warning)
    if (loaded := first.reference_map).unreadable:
        warn(f'{name}: {loaded.unreadable} kept images cannot be used; {loaded.unreadable_why}')
    if path := chosen.tum:
        if not poses:
            raise MapError(f'{path}: no accepted place has a pose; build the map with --odom')
        write_lines(path, tum(poses))
    return summarize(matches, durations)


def in_words(summary: dict[str, Any], slow: str) -> str:
    """Return a summary in a line; `slow` is why it took long, or empty."""
    reasons = ', '.join(f'{count} {reason}' for reason, count in summary['reasons'].items())
    return (
        f'{summary["frames"]} frames ({reasons}); '
        f'mean sequence length {summary["mean_sequence_length"]:.1f}, '
        f'median {summary["median_ms"]:.1f} ms a frame{f" ({slow})" if slow else ""}'
    )


@contextmanager
def opened(path: Path) -> Iterator[Listener]:
    """Open a table or, by the file's name, a recording; yield a function that writes to it."""
    if path.suffix == '.mcap':
        need_ros(str(path))
        # Imported by name, because commands run without ROS.
        module = import_module('convseq_ros.node.outputs.result_recording')
        with module.ResultRecording(path) as recording:
            yield recording.write
        return
    with ResultWriter(path, COLUMNS) as table:

        def write(frame: Frame, match: Match, _: PlaceRecognizer, duration_ms: float) -> None:
            table.write(row(match, duration_ms, frame.source))

        yield write


def _save(pipeline: Pipeline) -> None:
    """Write new places to the map; a full disk is a warning and does not end the replay."""
    try:
        pipeline.save()
    except MapError as error:
        warn(str(error))


def replay(
    source: Source, cameras: Cameras, *listeners: Listener
) -> Iterator[tuple[Match, float]]:
    """Tell and yield the match of every frame with the time that it took, in milliseconds."""
    for frame in progress(source, len(source), source.name):
        started = time.perf_counter()
        match = cameras.process(frame)
        if match.reason is Reason.UNREADABLE:
            warn(f'frame {match.query_index}: {frame.problem}')
        duration_ms = (time.perf_counter() - started) * 1e3
        for tell in listeners:
            tell(frame, match, cameras.of(frame.source), duration_ms)
        yield match, duration_ms


def summarize(matches: list[Match], durations_ms: list[float]) -> dict[str, Any]:
    """Return counts, mean sequence length, and the median time of frames not between keyframes."""
    lengths = [match.sequence_length for match in matches if match.sequence_length]
    busy_ms = [
        duration_ms
        for match, duration_ms in zip(matches, durations_ms, strict=True)
        if match.reason is not Reason.BETWEEN_KEYFRAMES
    ]
    return {
        'frames': len(matches),
        'accepted': sum(match.accepted is not None for match in matches),
        'reasons': dict(Counter(match.reason.value for match in matches)),
        'mean_sequence_length': statistics.fmean(lengths) if lengths else 0.0,
        'median_ms': statistics.median(busy_ms) if busy_ms else 0.0,
    }
