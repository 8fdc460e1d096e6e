# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording holds, and the commands that use it, ready to paste."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from convseq_ros.cli.options import quoted, quoted_path
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ImageError, printable, SourceError
from convseq_ros.sources import open_source
from convseq_ros.sources.images import ENCODINGS
from convseq_ros.sources.raw_message import COMPRESSED_IMAGE, IMAGE_TYPES, RawMessage
from convseq_ros.sources.recording import read_camera_in
from convseq_ros.sources.recording_names import holds_recording
from convseq_ros.sources.storage import is_storage_file, open_storage, Storage
from convseq_ros.sources.topic_rank import camera_info_beside, image_rank
from convseq_ros.sources.topics import CAMERA_TYPES, merge_topics, not_read, POSE_TYPES, Topic

_REMAPPED = {'--topic': 'image', '--odom': 'odom', '--camera-info': 'camera_info'}
_FIXES = 'sensor_msgs/msg/NavSatFix'
_DRAWN = 'debug_image'  # ends the topic of a picture that a node draws
_GREY = '8UC1', 'mono8', 'mono16'  # of encodings, best first, after all of colour


def describe_recording(path: Path, reading: ReadingConfig = ReadingConfig()) -> dict[str, Any]:
    """
    Return what a recording, a folder of pictures or a video holds; SourceError if unreadable.

    The keys are `recording`, `images`, `warnings`, and for a recording `seconds`, `topics` (with
    topic, type, messages and rate_hz, which is None for a single message) and `use` (for each
    option, the topics that it could name, best first). Depth images do not count.
    """
    if not (path.is_dir() and holds_recording(path)) and not is_storage_file(path):
        source = open_source(path, reading=reading)
        return {'recording': str(path), 'images': len(source), 'warnings': source.warnings}
    storages, warnings = open_storage(path, reading)
    topics = merge_topics(storage.topics for storage in storages)
    seconds = sum(storage.duration_s for storage in storages)
    warnings = [*warnings, *(storage.damage for storage in storages if storage.damage)]
    filled = [topics[name] for name in sorted(topics) if topics[name].count]
    images = _image_topics(filled, storages)
    poses = [topic for topic in filled if topic.type_name in POSE_TYPES]
    # `/odom` first, as the node takes it; others may be the truth, or of another source.
    poses.sort(key=lambda topic: (POSE_TYPES.index(topic.type_name), topic.name != '/odom'))
    return {
        'recording': str(path),
        'images': sum(topics[name].count for name in images),
        'seconds': seconds,
        'topics': [_described(topics[name], seconds) for name in sorted(topics)],
        'use': {
            '--topic': images,
            '--odom': [topic.name for topic in poses],
            '--camera-info': [*_camera_topics(path, filled, images, reading)],
        },
        'warnings': warnings,
    }


def _described(topic: Topic, seconds: float) -> dict[str, Any]:
    several = topic.count > 1 and seconds > 0
    rate = round((topic.count - 1) / seconds, 2) if several else None
    kind = topic.type_name
    return {'topic': topic.name, 'type': kind, 'messages': topic.count, 'rate_hz': rate}


def _image_topics(topics: Sequence[Topic], storages: Sequence[Storage]) -> list[str]:
    """Return the topics of a camera's images, colour first; none of depth, none that is drawn."""
    ranks = dict[str, tuple[int, bool]]()
    for topic in topics:
        if topic.type_name not in IMAGE_TYPES or topic.name.endswith(f'/{_DRAWN}'):
            continue
        encoding = _encoding(topic, storages)
        if encoding in ('', *ENCODINGS):
            rank = _GREY.index(encoding) + 1 if encoding in _GREY else 0
            ranks[topic.name] = rank, topic.type_name == COMPRESSED_IMAGE
    return sorted(ranks, key=lambda name: (ranks[name], image_rank(name), name))


def _encoding(topic: Topic, storages: Sequence[Storage]) -> str:
    """Return the encoding of a topic's first image; empty if it does not tell."""
    messages = (
        message
        for storage in storages
        if topic.name in storage.topics
        for message in storage.messages(topic.name)
    )
    try:
        return _encoding_of(next(messages))
    except (ImageError, SourceError, StopIteration):
        return ''


def _encoding_of(message: RawMessage) -> str:
    image: Any = message.image()
    if message.type_name != COMPRESSED_IMAGE:
        return str(image.encoding)
    encoding, is_of_plugin, _ = str(image.format).partition(';')  # such as `rgb8; jpeg compressed`
    return encoding.strip() if is_of_plugin else ''


def _camera_topics(
    path: Path, topics: Sequence[Topic], images: Sequence[str], reading: ReadingConfig
) -> Iterator[str]:
    """Yield the topics of calibrated cameras; the one beside the best images is first."""
    names = [topic.name for topic in topics if topic.type_name in CAMERA_TYPES]
    beside = camera_info_beside(images[0]) if images else ''
    for name in sorted(names, key=lambda name: (name != beside, name)):
        try:
            read_camera_in(path, name, reading)
        except SourceError:
            continue
        yield name


def recording_lines(facts: dict[str, Any]) -> list[str]:
    """Return the result of `describe_recording` as lines for people."""
    lines = [f'{printable(facts["recording"])}: {facts["images"]} images']
    if 'topics' in facts:
        lines[0] += f', {facts["seconds"]:.1f} s'
        rows = [
            (printable(fact['topic']), printable(fact['type']), fact) for fact in facts['topics']
        ]
        width = max((len(topic) for topic, *_ in rows), default=0)
        for topic, kind, fact in rows:
            rate = '' if fact['rate_hz'] is None else f', {fact["rate_hz"]:g} Hz'
            lines.append(f'  {topic:{width}}  {kind}, {fact["messages"]} messages{rate}')
    lines += [
        f'{printable(fact["topic"])} has satellite fixes, which are no poses; '
        'docs/howto/satellite_fixes.md makes a file for --poses of them'
        for fact in facts.get('topics', [])
        if fact['type'] == _FIXES
    ]
    missing = [option for option, names in facts.get('use', {}).items() if not names]
    topics = [Topic(fact['topic'], fact['type'], 1) for fact in facts.get('topics', [])]
    lines += [printable(line) for option in missing for line in not_read(topics, option)]
    lines += [f'warning: {printable(text)}' for text in facts['warnings']]
    if not facts['images']:
        return [*lines, '', 'no images of a camera: no map can be made of it']
    chosen, others = _chosen(facts.get('use', {}))
    options = ''.join(f' {option} {quoted(name)}' for option, name in chosen.items())
    recording = quoted_path(facts['recording'])
    lines += ['', 'to make a map of it:', f'  convseq build-map {recording} map.db{options}']
    remaps = ''.join(f' -r {_REMAPPED[option]}:={quoted(name)}' for option, name in chosen.items())
    if 'topics' in facts:
        lines += ['the same, live:', f'  vpr_node --ros-args -p map_path:=map.db{remaps}']
        if not facts['recording'].endswith('.bag'):  # of ROS 1
            lines += ['and in another terminal:', f'  ros2 bag play {recording}']
    if others:
        lines += ['or, of several:', *others]
    return lines


def _chosen(use: dict[str, list[str]]) -> tuple[dict[str, str], list[str]]:
    """Return the best topic for each option, and lines for the others."""
    chosen = {option: names[0] for option, names in use.items() if names}
    image, info = chosen.get('--topic', ''), chosen.get('--camera-info', '')
    if info and len(use['--topic']) > 1 and info != camera_info_beside(image):
        del chosen['--camera-info']  # it may describe another camera
    others = [
        f'  {option} {quoted(name)}'
        for option, names in use.items()
        for name in names
        if name != chosen.get(option)
    ]
    return chosen, others
