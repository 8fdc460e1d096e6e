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
import shlex
import sys
from typing import Any

from convseq_ros import __version__
from convseq_ros.cli.map_picture import draw_map
from convseq_ros.cli.options import printable, warn
from convseq_ros.config.reading_config import add_reading, chosen_reading, ReadingConfig
from convseq_ros.core.compiled import library
from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.evaluation.provenance import processor, version_of
from convseq_ros.sources import holds_recording, is_recording_file, open_source
from convseq_ros.sources.raw_message import IMAGE_TYPES
from convseq_ros.sources.storage import is_storage_file, open_storage
from convseq_ros.sources.topics import CAMERA_TYPES, merge_topics, POSE_TYPES, Topic
import cv2
import numpy as np

_OPTIONS = {'--topic': IMAGE_TYPES, '--odom': POSE_TYPES, '--camera-info': CAMERA_TYPES}
_REMAPPED = {'--topic': 'image', '--odom': 'odom', '--camera-info': 'camera_info'}


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
    parser.add_argument('--picture', type=Path, metavar='FILE', help='draw a map and its links')
    add_reading(parser)


def run(chosen: argparse.Namespace) -> int:
    """Print what the map or the recording holds, or what is installed."""
    file: Path | None = chosen.file
    if file is None:
        installed = describe_installation()
        lines = [f'{name:12} {fact}'.rstrip() for name, fact in installed.items()]
        print(json.dumps(installed) if chosen.json else '\n'.join(lines))
        return 0
    if file.is_dir() or is_recording_file(file):
        facts = describe_recording(file, chosen_reading(chosen))
        print(json.dumps(facts) if chosen.json else '\n'.join(recording_lines(facts)))
        return 0
    reader = MapReader(file)
    opened = reader.reference_map()
    about = {'map': str(file), 'format': FORMAT_VERSION, **reader.about()}
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
        print(f'{chosen.picture}: drawn {draw_map(chosen.picture, opened)}', file=sys.stderr)
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
    return (
        f'{session["session"]} {printable(session["name"] or "(no name)")}: '
        f'{session["references"]} references{with_pose}{frame}, {session["path_m"]:.1f} m, '
        f'from {time:%Y-%m-%d %H:%M:%S} UTC, id {printable(session["id"])}'
    )


def describe_recording(path: Path, reading: ReadingConfig = ReadingConfig()) -> dict[str, Any]:
    """
    Return what a recording, a folder of pictures or a video holds; SourceError if unreadable.

    The keys are `recording`, `images`, `warnings`, and for a recording `seconds`, `topics` (with
    topic, type, messages and rate_hz, which is None for a single message) and `use` (for each
    option, the topics that it could name).
    """
    if not (path.is_dir() and holds_recording(path)) and not is_storage_file(path):
        images = len(open_source(path, reading=reading))
        return {'recording': str(path), 'images': images, 'warnings': []}
    storages, warnings = open_storage(path, reading)
    topics = merge_topics(storage.topics for storage in storages)
    seconds = sum(storage.duration_s for storage in storages)
    warnings = [*warnings, *(storage.damage for storage in storages if storage.damage)]
    filled = [topic for topic in topics.values() if topic.count]
    return {
        'recording': str(path),
        'images': sum(topic.count for topic in filled if topic.type_name in IMAGE_TYPES),
        'seconds': seconds,
        'topics': [_described(topics[name], seconds) for name in sorted(topics)],
        'use': {
            option: sorted(topic.name for topic in filled if topic.type_name in types)
            for option, types in _OPTIONS.items()
        },
        'warnings': warnings,
    }


def _described(topic: Topic, seconds: float) -> dict[str, Any]:
    several = topic.count > 1 and seconds > 0
    rate = round((topic.count - 1) / seconds, 2) if several else None
    kind = topic.type_name
    return {'topic': topic.name, 'type': kind, 'messages': topic.count, 'rate_hz': rate}


def recording_lines(facts: dict[str, Any]) -> list[str]:
    """Return the result of `describe_recording` as lines for people."""
    lines = [f'{facts["recording"]}: {facts["images"]} images']
    commands = f'convseq build-map {shlex.quote(facts["recording"])} map.db'
    if 'topics' in facts:
        lines[0] += f', {facts["seconds"]:.1f} s'
        rows = [
            (printable(fact['topic']), printable(fact['type']), fact) for fact in facts['topics']
        ]
        width = max((len(topic) for topic, *_ in rows), default=0)
        for topic, kind, fact in rows:
            rate = '' if fact['rate_hz'] is None else f', {fact["rate_hz"]:g} Hz'
            lines.append(f'  {topic:{width}}  {kind}, {fact["messages"]} messages{rate}')
    lines += [f'warning: {text}' for text in facts['warnings']]
    chosen, others = {}, []
    for option, names in facts.get('use', {}).items():
        if names:
            chosen[option] = names[0]
        others += [f'  {option} {quoted(name)}' for name in names[1:]]
    options = ''.join(f' {option} {quoted(name)}' for option, name in chosen.items())
    lines += ['', 'to make a map of it:', f'  {commands}{options}']
    if 'topics' in facts:
        remaps = ''.join(
            f' -r {_REMAPPED[option]}:={quoted(name)}' for option, name in chosen.items()
        )
        lines += ['the same, live:', f'  vpr_node --ros-args -p map_path:=map.db{remaps}']
    if others:
        lines += ['or, of several:', *others]
    return lines


def quoted(name: str) -> str:
    """Return a name of unknown origin, quoted as one word for a shell."""
    return shlex.quote(printable(name))
