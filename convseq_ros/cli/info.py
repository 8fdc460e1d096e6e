# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Say what a map or a recording holds: `convseq info FILE`."""

import argparse
from datetime import datetime, UTC
from itertools import pairwise
import json
import math
from pathlib import Path

from convseq_ros.cli.printable import printable
from convseq_ros.cli.recording_info import describe_recording, is_recording, recording_lines
from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('file', type=Path, help='map or recording; it is not changed')
    parser.add_argument('--json', action='store_true', help='print as JSON')


def run(chosen: argparse.Namespace) -> int:
    """Print what the map or the recording holds."""
    file: Path = chosen.file
    if file.is_dir() or is_recording(file):
        found = describe_recording(file)
        print(json.dumps(found) if chosen.json else '\n'.join(recording_lines(found)))
        return 0
    reader = MapReader(file)
    facts = {
        'map': str(file),
        'format': FORMAT_VERSION,
        'bytes': file.stat().st_size,
        **reader.about(),
        **describe_places(reader.reference_map()),
    }
    if chosen.json:
        print(json.dumps(facts))
    else:
        for name, fact in facts.items():
            print(f'{name.replace("_", " "):12} {_readable(name, fact)}')
    return 0


def describe_places(reference_map: ReferenceMap) -> dict[str, object]:
    """Return counts, time span and the length of the drives' paths through the poses."""
    places = list(reference_map.places)
    known = [place for place in places if place.pose]
    ways = [
        math.dist(one.pose.position, other.pose.position)
        for one, other in pairwise(known)
        if one.pose and other.pose and one.session == other.session
    ]
    return {
        'references': len(places),
        'first_stamp_ns': places[0].stamp_ns if places else None,
        'last_stamp_ns': places[-1].stamp_ns if places else None,
        'sources': sorted({place.source for place in places})[:5],
        'sessions': len(reference_map.sessions),
        'with_pose': len(known),
        'path_m': sum(ways, 0.0),
    }


def _readable(name: str, fact: object) -> str:
    if name.endswith('_ns') and isinstance(fact, int):
        time = datetime.fromtimestamp(fact / 1e9, UTC)
        return f'{fact}  ({time:%Y-%m-%d %H:%M:%S} UTC)'
    if isinstance(fact, float):
        return f'{fact:.1f}'
    text = ', '.join(fact) if isinstance(fact, list) else str(fact)
    return printable(text)
