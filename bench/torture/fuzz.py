# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fuzzes every decoder with libFuzzer, guided by the coverage of the Python code through Atheris.

`python -m bench.torture.fuzz COUNT SEED FOLDER [DECODER ...]` prints the number of executions and
the problem of each decoder as JSON. An input that causes a problem is kept in `FOUND`.
"""

from collections.abc import Iterator, Mapping
import contextlib
import hashlib
from importlib.util import find_spec
import io
import json
import mmap
import os
from pathlib import Path
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import traceback
from typing import Any, NoReturn

import cv2

from bench.torture.attack import Attack, Try
from bench.torture.forked import MOST_BYTES, MOST_S

MISSING = '' if find_spec('atheris') else "Atheris is missing; run: pip install '.[torture]'"
FOUND = Path(tempfile.gettempdir(), 'convseq_fuzz')
_MOST_INPUT_BYTES = 1 << 20  # libFuzzer's inputs are not longer than the longest sample
_LAST = struct.Struct('qq')  # header: executions so far, and length of the last input
_MOST_ERROR = 2000  # characters of an error
_LONGEST_S = 600  # of a blocked run, as on a pipe; includes time while the machine is suspended


def _run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run a program that fuzzes every decoder `count` times."""
    if MISSING:
        raise SystemExit(f'fuzz: {MISSING}')
    command = [sys.executable, '-m', 'bench.torture.fuzz', str(count), str(seed), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        for line in process.stdout:
            name, executions, problem = json.loads(line)
            yield from (Try(name) for _ in range(executions - 1))
            yield Try(name, problem)
    if process.returncode:
        yield Try('all', f'ended with {process.returncode}')


def main(targets: Mapping[str, Any] | None = None) -> None:
    """Fuzz the named decoders, or all, each in a fork of this process."""
    import atheris

    # Atheris prints every module that it instruments.
    with (
        contextlib.redirect_stderr(io.StringIO()),
        atheris.instrument_imports(include=['convseq_ros']),
    ):
        from bench.torture import decoders

    cv2.setNumThreads(1)
    count, seed, folder, *names = sys.argv[1:]
    targets = targets or decoders.decoders()
    for name in names or targets:
        with tempfile.TemporaryDirectory(dir=folder) as made:
            base, last = Path(made), mmap.mmap(-1, _MOST_INPUT_BYTES)
            if not (child := os.fork()):
                (base / 'words').write_text(''.join(f'"{word}"\n' for word in decoders.WORDS))
                _be_libfuzzer(targets[name], int(count), seed, base, last)
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            executions, length = _LAST.unpack_from(last)
            problem = ''
            if code or executions < int(count):
                report, data = base / 'problem', last[_LAST.size : _LAST.size + length]
                kept = f'{name.replace(" ", "_")}-{hashlib.sha1(data).hexdigest()[:8]}'
                FOUND.mkdir(exist_ok=True)
                (FOUND / kept).write_bytes(data)
                detail = report.read_text(encoding='utf-8') if report.exists() else ''
                problem = f'{detail or f"ended with {code}, or took too much"}; {kept}'
        print(json.dumps([name, executions, problem]), flush=True)


def _be_libfuzzer(decoder: Any, count: int, seed: str, folder: Path, last: mmap.mmap) -> NoReturn:
    """Fuzz a decoder until it fails; however this process ends, `last` has the last input."""
    import atheris
    from convseq_ros.errors import ConvseqError

    samples, decode = decoder
    work, executions = folder / 'work', 0
    work.mkdir()
    (folder / 'samples').mkdir()
    for number, sample in enumerate(samples):
        (folder / 'samples' / f'{number}').write_bytes(sample)

    def once(data: bytes) -> None:
        nonlocal executions
        executions += 1
        last[_LAST.size : _LAST.size + len(data)] = data
        _LAST.pack_into(last, 0, executions, len(data))
        signal.setitimer(signal.ITIMER_PROF, MOST_S)
        try:
            decode(data, work)
        except ConvseqError as error:
            if len(str(error)) > _MOST_ERROR:
                raise
        except BaseException:
            lines = [line.strip() for line in traceback.format_exc().splitlines()]
            summary = ' | '.join([line for line in lines if line.strip('^~ ')][-4:])
            (folder / 'problem').write_text(summary[:500], encoding='utf-8', errors='replace')
            raise
        for path in work.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    # Limit the CPU time: libFuzzer's limit is wall-clock time, which includes other programs.
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
        os._exit(1)


ATTACKS = {
    'fuzz': Attack(
        'Every decoder, fuzzed by Atheris (libFuzzer) from valid samples: pictures, raw and '
        'compressed images, camera_info, poses, recordings, maps, masks, result tables, truth, '
        'YAML',
        'an answer, or an error of ours in one line; within 5 s, below 1 GB',
        20_000, 20_000, 20, _run,
    )
}  # fmt: skip

if __name__ == '__main__':
    main()
