# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Print what a map or a recording holds, or what is installed: `convseq info [FILE]`."""

import argparse
from datetime import datetime, UTC
from itertools import groupby, pairwise
import json
import math
from operator import attrgetter
import os
from pathlib import Path
import platform
import sys
from typing import Any

from convseq_ros import __version__
from convseq_ros.cli.map_picture import draw_map
from convseq_ros.cli.options import warn
from convseq_ros.cli.outputs import add_output
from convseq_ros.cli.recording import describe_recording, recording_lines
from convseq_ros.config.reading_config import add_reading, chosen_reading
from convseq_ros.core.compiled import library
from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import as_parameter
from convseq_ros.core.types import Camera
from convseq_ros.errors import ConfigError, printable
from convseq_ros.evaluation.provenance import processor, version_of
from convseq_ros.io.output_file import FIGURE
from convseq_ros.sources.recording_names import is_recording_file
import cv2
import numpy as np


def describe_installation() -> dict[str, str | int]:
    """Return versions, kernels, processor and number of cores, by name."""
    compiled = library()
    return {
        'convseq_ros': __version__,
        'python': platform.python_version(),
        'numpy': np.__version__,
        'opencv': cv2.__version__,
        'rclpy': version_of('rclpy', 'ros-rclpy'),
        'kernels': compiled.variant or f'numpy: {compiled.problem}',
        'machine': platform.machine(),
        'processor': processor(),
        'cores': os.cpu_count() or 0,
        'system': platform.platform(),
        'ros': os.environ.get('ROS_DISTRO', ''),
        'rmw': os.environ.get('RMW_IMPLEMENTATION', ''),
    }


def describe(parser: argparse.ArgumentParser) -> None:
    help_ = 'map or recording; it is not changed; without one: versions, kernels, processor'
    parser.add_argument('file', type=Path, nargs='?', help=help_)
    parser.add_argument('--json', action='store_true', help='print as JSON')
    help_ = 'draw a map and its links'
    add_output(parser, '--picture', kinds=FIGURE, metavar='FILE', help=help_)
    add_reading(parser)


def run(chosen: argparse.Namespace) -> int:
    """Print what the map or the recording holds, or what is installed."""
    file: Path | None = chosen.file
    is_map = file and not (file.is_dir() or is_recording_file(file))
    if chosen.picture and not is_map:
        instead = f' instead of {file}' if file else ''
        raise ConfigError(f'--picture: draws a map; name one{instead}')
    if file is None:
        installed = describe_installation()
        lines = [f'{name:12} {fact}'.rstrip() for name, fact in installed.items()]
        print(json.dumps(installed) if chosen.json else '\n'.join(lines))
        return 0
    if not is_map:
        facts = describe_recording(file, chosen_reading(chosen))
        print(json.dumps(facts) if chosen.json else '\n'.join(recording_lines(facts)))
        return 0
    opened = open_map(file)
    about = {'map': str(file), 'format': FORMAT_VERSION, **MapReader(file).about()}
    facts = about | describe_map(file, opened)
    if opened.encoding.descriptor_model:
        numbers, size = opened.global_descriptors.shape[1], opened.global_descriptors.nbytes
        facts |= {'descriptor_numbers': numbers, 'descriptor_bytes': size}
    if opened.problem:
        warn(opened.problem)
    if chosen.json:
        print(json.dumps(facts))
    else:
        for name, fact in facts.items():
            print(f'{name.replace("_", " "):12} {_readable(name, fact)}')
        print(in_short(facts))
    if chosen.picture:
        draw_map(chosen.picture, opened, file)
        print(f'{chosen.picture}: drawn', file=sys.stderr)
    return 0


def in_short(facts: dict[str, Any]) -> str:
    """Return the numbers of keyframes, places and links in a line."""
    keyframes, places = facts['references'], facts['places']
    if not facts['linked']:
        return f'{keyframes} keyframes, not all of them linked: convseq map link {facts["map"]}'
    times = f', each passed {keyframes / places:.1f} times' if facts['links'] else ''
    return (
        f'{keyframes} keyframes, {places} places{times}; {facts["links"]} links, '
        f'{facts["links_between_sessions"]} between sessions'
    )


def describe_map(path: Path, reference_map: ReferenceMap) -> dict[str, Any]:
    """Return counts, time span and length of the drives; linked keyframes count as one place."""
    places, links = list(reference_map.places), [*reference_map.links.each()]
    drives = {number: [*drive] for number, drive in groupby(places, attrgetter('session'))}
    sessions = [
        {
            'session': number,
            'name': session.name,
            'id': session.id,
            'start_ns': session.start_ns,
            **_describe_drive(drives.get(number, [])),
            'camera': bool(session.camera),
            'frame': session.frame,
            'camera_to_base': _mount(session.camera),
        }
        for number, session in enumerate(reference_map.sessions)
    ]
    return {
        'map': str(path),
        'bytes': path.stat().st_size,
        'references': len(places),
        'places': len(places) - len(links),
        'links': len(links),
        'links_between_sessions': sum(
            places[link.place].session != places[link.other].session for link in links
        ),
        'linked': reference_map.is_linked,
        'first_stamp_ns': places[0].stamp_ns if places else None,
        'last_stamp_ns': places[-1].stamp_ns if places else None,
        'sources': sorted({place.source for place in places})[:5],
        'with_pose': sum(place.pose is not None for place in places),
        'path_m': sum((session['path_m'] for session in sessions), 0.0),
        'sessions': sessions,
    }


def _mount(camera: Camera | None) -> str | None:
    return as_parameter(camera.mount) if camera and camera.mount else None


def _describe_drive(places: list[Place]) -> dict[str, Any]:
    positions = [place.pose.position for place in places if place.pose]
    steps_m = [math.dist(*both) for both in pairwise(positions)]
    return {'references': len(places), 'with_pose': len(positions), 'path_m': sum(steps_m, 0.0)}


def _readable(name: str, fact: object) -> str:
    if name.endswith('_ns') and isinstance(fact, int):
        time = datetime.fromtimestamp(fact / 1e9, UTC)
        return f'{fact}  ({time:%Y-%m-%d %H:%M:%S} UTC)'
    if isinstance(fact, float):
        return f'{fact:.1f}'
    if name == 'sessions' and isinstance(fact, list):
        return '\n'.join([str(len(fact)), *(f'  {_line(session)}' for session in fact)])
    return printable(', '.join(fact) if isinstance(fact, list) else str(fact))


def _line(session: dict[str, Any]) -> str:
    time = datetime.fromtimestamp(session['start_ns'] / 1e9, UTC)
    with_pose = f', {session["with_pose"]} with a pose' if session['with_pose'] else ''
    frame = f' in {printable(session["frame"])}' if session['frame'] else ''
    mount = f', camera_to_base "{at}"' if (at := session['camera_to_base']) else ''
    return (
        f'{session["session"]} {printable(session["name"] or "(no name)")}: '
        f'{session["references"]} references{with_pose}{frame}, {session["path_m"]:.1f} m, '
        f'from {time:%Y-%m-%d %H:%M:%S} UTC, id {printable(session["id"])}{mount}'
    )
