# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odd words on command lines, and streams that are closed, full or left by their reader."""

from collections.abc import Iterator
import os
from pathlib import Path
import random
import re
import subprocess
import sys

from bench import recordings
from bench.torture.attack import Try
from bench.torture.forked import ended

_WORDS = (
    b'caf\xe9', b'two\nlines', b"it's", b'a b', b'/a//b', b'd epth', b'1a', b'{', b'~', b'',
    b'x' * 3000, b'0x' + b'f' * 4000,
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
_OF_NODES = '-p image_topics:=@', '-r image:=@', '-p @:=1', '-p max_wait_s:=@'
_OF_TOPICS = b'caf\xe9', b'two\nd-epth', b"it's", b'/a//b', b'd-epth', b'1a', b'{', _WORDS[-1]
_STREAMS = '', '', '>&-', '2>&-', '>&- 2>&- <&-', '> /dev/full', '2> /dev/full', '| true'
_LIMITS = 'ulimit -f 1', 'ulimit -n 14'  # a file of 1 kB; 14 files
_CONVSEQ = sys.executable, '-m', 'convseq_ros.cli'
_NODE = sys.executable, '-m', 'convseq_ros.node', '--ros-args'


def odd_words(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run commands with one odd word or stream, and see how they end."""
    draw = random.Random(seed)
    os.chdir(folder)
    os.environ |= {'ROS_LOG_DIR': str(folder), 'PYTHONPATH': os.pathsep.join(sys.path)}
    recordings.write_pictures(Path('drive'), 3)
    make = [*_CONVSEQ, 'build-map', 'drive', 'made.db']
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    for number in range(count):
        is_node = draw.random() < 0.3
        words = draw.choice(_OF_NODES if is_node else _COMMANDS)
        odd = draw.choice(_OF_TOPICS if is_node else _WORDS)
        stream = '' if is_node else draw.choice((*_STREAMS, *_LIMITS))
        arguments = [word.replace(_PLACE, odd) for word in words.encode().split()]
        problem = _problem([*(_NODE if is_node else _CONVSEQ), *arguments], stream)
        for left in {*folder.iterdir()} - {folder / 'drive', folder / 'made.db'}:
            if left.is_file():
                left.unlink()
        yield Try(f'{number}: {words} with {odd[:9]!r} {stream}', problem)


def _problem(command: list[str | bytes], stream: str) -> str:
    """Run a command with a stream or limit as bash writes it; return what was wrong."""
    is_limit = stream in _LIMITS
    line = f'{stream}; "$@"' if is_limit else f'set -o pipefail; "$@" {stream}'
    end = ended(lambda: os.execvp('bash', ['bash', '-c', line, 'bash', *command]))
    if end.problem and not ('2>' in stream and end.code == 1 and not end.told):
        return end.problem
    if end.code == 0 and stream == '> /dev/full':
        return 'what was printed is lost, exit 0'
    is_map = b'build-map' in command and b'map.db' in command
    if is_map and end.code == 0 and not Path('map.db').exists():
        return 'no map, exit 0'
    if is_limit and re.search('^[^:]*: File too large$', end.told, re.MULTILINE):
        return f'the file is not named: {end.told}'
    return ''
