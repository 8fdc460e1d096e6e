# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Atheris on every decoder: `python -m bench.torture._fuzzer COUNT SEED FOLDER [DECODER ...]`.

It prints a JSON line for every run of libFuzzer, which is led by the lines of convseq_ros that an
input reaches. What breaks a decoder is kept in a folder of the system's for temporary files.
"""

from collections.abc import Iterator
import contextlib
import hashlib
import io
import json
import mmap
import os
from pathlib import Path
import resource
import shutil
import signal
import struct
import sys
import tempfile
import traceback
from typing import NoReturn

import atheris

from bench.torture.forked import MOST_BYTES, MOST_S

# It names every module that it instruments.
with (
    contextlib.redirect_stderr(io.StringIO()),
    atheris.instrument_imports(include=['convseq_ros']),
):
    from convseq_ros.errors import ConvseqError

    from bench.torture import decoders

import cv2

_MOST_FINDS = 5  # of a decoder, which is then left alone
_APART = 1000  # between seeds of a decoder that broke
_MOST_SAID = 2000  # characters of an error
_MOST_INPUT_BYTES = 1 << 20  # libFuzzer makes none longer than the longest sample
_LONGEST_S = 600  # of a run that does nothing, as on a pipe; the machine may be stopped meanwhile
_FOUND = Path(tempfile.gettempdir(), 'convseq_fuzz')
_BROKE = 255
_ENDS = {  # a signal, or an exit code of libFuzzer's
    -signal.SIGPROF: f'took more than {MOST_S:g} s',
    70: f'took more than {_LONGEST_S} s',
    71: f'took more than {MOST_BYTES / 1e9:g} GB',
    77: 'crashed',
}


class Last:
    """The last input of a child, and how many it had, whatever becomes of it."""

    _HEAD = struct.Struct('qq')

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, _MOST_INPUT_BYTES)

    def begin(self, data: bytes) -> None:
        """Count an input."""
        start, end = self._HEAD.size, self._HEAD.size + len(data)
        self._shared[start:end] = data
        self._HEAD.pack_into(self._shared, 0, self.count + 1, len(data))

    @property
    def count(self) -> int:
        return int(self._HEAD.unpack_from(self._shared)[0])

    @property
    def data(self) -> bytes:
        _, length = self._HEAD.unpack_from(self._shared)
        return self._shared[self._HEAD.size : self._HEAD.size + length]


def fuzz(name: str, count: int, seed: int, folder: Path) -> Iterator[tuple[int, str]]:
    """Yield how often a decoder was executed until it broke, or all was done, and what broke."""
    left, finds = count, 0
    while left > 0 and finds < _MOST_FINDS:
        with tempfile.TemporaryDirectory(dir=folder) as made:
            own, last = Path(made), Last()
            if not (child := os.fork()):
                _fuzz_until_it_breaks(name, left, seed + _APART * finds, own, last)
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            said = own / 'problem'
            problem = said.read_text(encoding='utf-8') if said.exists() else _ENDS.get(code, '')
        left -= last.count
        if code:
            finds += 1
            path = _FOUND / f'{name.replace(" ", "_")}-{hashlib.sha1(last.data).hexdigest()[:8]}'
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(last.data)
            problem = f'{problem or f"ended with {code}"}; {path.name}'
        elif left > 0:
            problem = f'{left} executions are missing'
            left = 0
        yield last.count, problem


def _fuzz_until_it_breaks(name: str, count: int, seed: int, folder: Path, last: Last) -> NoReturn:
    """Be libFuzzer, which ends this process."""
    samples, decode = decoders.decoders()[name]
    for each in ('samples', 'work'):
        (folder / each).mkdir()
    for number, sample in enumerate(samples):
        (folder / 'samples' / f'{number}').write_bytes(sample)
    (folder / 'words').write_text(''.join(f'"{word}"\n' for word in decoders.WORDS))
    work = folder / 'work'

    def once(data: bytes) -> None:
        last.begin(data)
        signal.setitimer(signal.ITIMER_PROF, MOST_S)
        try:
            decode(data, work)
        except ConvseqError as error:
            if len(str(error)) > _MOST_SAID:
                raise
        except BaseException:
            lines = [line.strip() for line in traceback.format_exc().splitlines()]
            said = ' | '.join([line for line in lines if line.strip('^~ ')][-4:])
            (folder / 'problem').write_text(said[:500], encoding='utf-8', errors='replace')
            raise
        for one in work.iterdir():
            shutil.rmtree(one) if one.is_dir() else one.unlink()

    # libFuzzer's own limit is by the clock, and this machine has other things to do.
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1), os.dup2(silence, 2)
    options = [
        f'-runs={count}',
        f'-seed={seed}',
        f'-timeout={_LONGEST_S}',
        f'-rss_limit_mb={MOST_BYTES // 10**6}',
        f'-dict={folder / "words"}',
        f'-artifact_prefix={folder}/',
    ]
    try:
        atheris.Setup(['fuzz', *options, str(folder / 'samples')], once)
        atheris.Fuzz()
    finally:
        os._exit(_BROKE)


def main() -> None:
    """Fuzz the decoders that are named, or all."""
    cv2.setNumThreads(1)
    count, seed, folder = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    for name in sys.argv[4:] or decoders.decoders():
        for executions, problem in fuzz(name, count, seed, folder):
            print(json.dumps([name, executions, problem]), flush=True)


if __name__ == '__main__':
    main()
