# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odd words on command lines, and streams that are closed, full or left by their reader."""

from collections.abc import Iterator
import os
from pathlib import Path
import random
import subprocess
import sys

import cv2

from bench.torture import corpus
from bench.torture.attack import Attack, Try

_MOST_S = 120.0
_WORDS = (
    b'caf\xe9', b'two\nlines', b"it's", b'a b', b'/a//b', b'd epth', b'1a', b'{', b'~', b'',
    b'x' * 3000,
)  # fmt: skip
_PLACE = b'@'  # of the word
_COMMANDS = (
    'info @', 'build-map @ map.db', 'build-map drive @', 'build-map drive map.db --session @',
    'build-map drive map.db --topic @', 'build-map drive map.db --odom @',
    'build-map drive map.db --poses @', 'build-map drive map.db --camera-info @',
    'build-map drive map.db --image-mask @', 'replay drive --map @',
    'replay drive --map made.db --output @', 'locate @ --map made.db', 'map rename made.db 0 @',
    'map link @', 'report @', 'evaluate @',
)  # fmt: skip
_OF_NODES = '-p image_topics:=@', '-p depth_topic:=@', '-r image:=@', '-p @:=1'
_OF_TOPICS = [word for word in _WORDS[:8] if word != b'a b']  # names of no topic
_RCL = '[rcl]: Failed to parse global arguments'  # which ROS says beside our line
_STREAMS = '', '', '>&-', '2>&-', '>&- 2>&- <&-', '> /dev/full', '2> /dev/full', '| true', 'ulimit'
_CONVSEQ = sys.executable, '-m', 'convseq_ros.cli'
_NODE = sys.executable, '-m', 'convseq_ros.node', '--ros-args'


def _run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run commands, each in a new folder, and see how they end."""
    draw = random.Random(seed)
    (folder / 'drive').mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f'drive/{number}.png'), corpus.gray(number))
    subprocess.run([*_CONVSEQ, 'build-map', 'drive', 'made.db'], cwd=folder, check=True)
    for number in range(count):
        is_node = draw.random() < 0.3
        words = draw.choice(_OF_NODES if is_node else _COMMANDS)
        odd = draw.choice(_OF_TOPICS if is_node else _WORDS)
        odd = odd.split()[0] + b'-' if 'image_topics' in words else odd  # which may be several
        stream = '' if is_node else draw.choice(_STREAMS)
        arguments = [word.replace(_PLACE, odd) for word in words.encode().split()]
        problem = _problem([*(_NODE if is_node else _CONVSEQ), *arguments], stream, folder)
        for left in {*folder.iterdir()} - {folder / 'drive', folder / 'made.db'}:
            if left.is_file():
                left.unlink()
        yield Try(f'{number}: {words} with {odd[:9]!r} {stream}', problem)


def _problem(command: list[str | bytes], stream: str, folder: Path) -> str:
    """Run a command with a stream or limit as bash writes it; return what was wrong."""
    is_limited = stream == 'ulimit'
    line = 'ulimit -f 1; "$@"' if is_limited else f'set -o pipefail; "$@" {stream}'
    variables = os.environ | {'ROS_LOG_DIR': str(folder), 'PYTHONPATH': os.pathsep.join(sys.path)}
    try:
        done = subprocess.run(
            ['bash', '-c', line, 'bash', *command],
            cwd=folder,
            env=variables,
            capture_output=True,
            timeout=_MOST_S,
        )
    except subprocess.TimeoutExpired:
        return f'took more than {_MOST_S:g} s'
    told = done.stderr.decode(errors='backslashreplace')
    lines = [
        one for one in told.splitlines() if not one.startswith('warning: ') and _RCL not in one
    ]
    if 'Traceback' in told or done.returncode not in (0, 1, 2):
        return f'exit {done.returncode}: {told[-400:]}'
    if done.returncode == 1 and len(lines) != 1 and '2>' not in stream:
        return f'exit 1 with {len(lines)} lines: {told[-400:]}'
    if done.returncode == 0 and stream == '> /dev/full':
        return 'what was printed is lost, exit 0'
    is_map = b'build-map' in command and b'map.db' in command
    if is_map and done.returncode == 0 and not (folder / 'map.db').exists():
        return 'no map, exit 0'
    if is_limited and 'File too large' in told and 'File too large' == lines[-1].split(': ')[1]:
        return f'the file is not named: {told}'
    return ''


ATTACKS = {
    'odd_words': Attack(
        'Words that are not UTF-8, have two lines, spaces or 3,000 letters, or name no topic, as '
        'files, topics and names of commands, and as parameters and remaps of `vpr_node`; '
        'standard streams that are closed, full or left by their reader; files that cannot grow, '
        'as on a full disk',
        'exit 0 with all that was asked for, or one line, exit 1, or 2 for wrong usage; no '
        'traceback; what cannot be written is named',
        200, 50, 8, _run,
    )
}  # fmt: skip
