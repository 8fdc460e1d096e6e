# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording holds, with the commands that use it, ready to paste."""

from pathlib import Path
import shlex
from typing import Any

from convseq_ros.cli.terminal import printable
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import holds_recording, open_source
from convseq_ros.sources.raw_message import IMAGE_TYPES
from convseq_ros.sources.storage import is_storage_file, open_storage
from convseq_ros.sources.topics import CAMERA_TYPES, merge_topics, POSE_TYPES, Topic
from convseq_ros.sources.video import VIDEO_SUFFIXES

_OPTIONS = {'--topic': IMAGE_TYPES, '--odom': POSE_TYPES, '--camera-info': CAMERA_TYPES}
_REMAPPED = {'--topic': 'image', '--odom': 'odom', '--camera-info': 'camera_info'}


def is_recording(path: Path) -> bool:
    """Tell whether a name is that of a recording's file, or a video's."""
    return is_storage_file(path) or path.suffix.lower() in VIDEO_SUFFIXES


def describe_recording(path: Path, reading: ReadingConfig = ReadingConfig()) -> dict[str, Any]:
    """
    Return what a recording, a folder of pictures or a video holds, if it is not too large.

    The keys are `recording`, `images`, `warnings`, and for a recording `seconds`, `topics` (each
    with topic, type, messages and rate_hz, None for a single message) and `use` (options, each
    with the topics that it could name). SourceError if there is none, or it cannot be read.

    """
    if not (path.is_dir() and holds_recording(path)) and not is_storage_file(path):
        images = len(open_source(path, reading=reading))
        return {'recording': str(path), 'images': images, 'warnings': []}
    storages, warnings = open_storage(path, reading)
    topics = merge_topics(storage.topics for storage in storages)
    seconds = sum(storage.duration_s for storage in storages)
    warnings = [*warnings, *(storage.damage for storage in storages if storage.damage)]
    held = [topic for topic in topics.values() if topic.count]
    return {
        'recording': str(path),
        'images': sum(topic.count for topic in held if topic.type_name in IMAGE_TYPES),
        'seconds': seconds,
        'topics': [_described(topics[name], seconds) for name in sorted(topics)],
        'use': {
            option: sorted(topic.name for topic in held if topic.type_name in types)
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
    """Return what `describe_recording` found, for people."""
    lines = [f'{facts["recording"]}: {facts["images"]} images']
    commands = f'convseq build-map {shlex.quote(facts["recording"])} map.db'
    if 'topics' in facts:
        lines[0] += f', {facts["seconds"]:.1f} s'
        shown = [
            (printable(each['topic']), printable(each['type']), each) for each in facts['topics']
        ]
        width = max((len(topic) for topic, *_ in shown), default=0)
        for topic, kind, each in shown:
            rate = '' if each['rate_hz'] is None else f', {each["rate_hz"]:g} Hz'
            lines.append(f'  {topic:{width}}  {kind}, {each["messages"]} messages{rate}')
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
    """Return a stranger's name as one word of a shell, whatever is in it."""
    return shlex.quote(printable(name))
