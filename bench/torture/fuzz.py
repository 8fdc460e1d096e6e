# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every decoder, given what is almost right, by libFuzzer, which Atheris leads along our lines.

`python -m bench.torture.fuzz COUNT SEED FOLDER DECODER` is such a program, for one decoder; it
prints how often it executed it, and what broke it, as JSON. That input is kept in `FOUND`.
"""

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import hashlib
from importlib.util import find_spec
import io
import os
from pathlib import Path
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from typing import Any

import cv2

from bench.torture.attack import Try
from bench.torture.forked import MOST_BYTES, MOST_S

ABOUT = (
    'Every decoder, fuzzed by Atheris (libFuzzer, led by the lines of convseq_ros that are '
    'reached) from valid samples: pictures, raw and compressed images, camera_info, poses, '
    'recordings, maps, masks, result tables, truth, YAML; so many executions each'
)
ORACLE = 'an answer, or an error of ours in one line; within 5 s, below 1 GB'
COUNT, PORTION, SHORT, SEED = 20_000, 20_000, 50, 16
MISSING = '' if find_spec('atheris') else "Atheris is missing; run: pip install '.[torture]'"
_PROGRAM = '-m', 'bench.torture.fuzz'
FOUND = Path(tempfile.gettempdir(), 'convseq_fuzz')
_MOST_SAID = 2000  # characters of an error
_LONGEST_S = 600  # of a run that does nothing, as on a pipe; the machine may be stopped meanwhile


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Have a program of its own fuzz every decoder `count` times."""
    if MISSING:
        raise SystemExit(f'fuzz: {MISSING}')
    from bench.torture.decoders import decoders

    for name in decoders():
        with tempfile.TemporaryDirectory(dir=folder) as own:
            executions, problem = fuzzed(name, count, seed, Path(own))
        yield from (Try(name) for _ in range(executions - 1))
        yield Try(name, problem)


def fuzzed(
    name: str, count: int, seed: int, folder: Path, program: Sequence[str] = _PROGRAM
) -> tuple[int, str]:
    """Return how often a decoder was executed until it broke, or all was done, and what broke."""
    command = [sys.executable, *program, str(count), str(seed), str(folder), name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    executions, last = int((folder / 'count').read_text()), folder / 'last'
    if not done.returncode and executions >= count:
        return executions, ''
    said = folder / 'problem'
    problem = said.read_text() if said.exists() else f'ended with {done.returncode}'
    data = last.read_bytes()
    kept = FOUND / f'{name.replace(" ", "_")}-{hashlib.sha1(data).hexdigest()[:8]}'
    FOUND.mkdir(exist_ok=True)
    kept.write_bytes(data)
    return executions, f'{problem}; {kept.name}'


def main(known: Mapping[str, Any] | None = None) -> None:
    """Be libFuzzer, which ends this process, on one of the decoders."""
    import atheris

    # It names every module that it instruments.
    with (
        contextlib.redirect_stderr(io.StringIO()),
        atheris.instrument_imports(include=['convseq_ros']),
    ):
        from convseq_ros.errors import ConvseqError

        from bench.torture import decoders

    cv2.setNumThreads(1)
    count, seed, folder, name = int(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), sys.argv[4]
    samples, decode = (known or decoders.decoders())[name]
    work, executions = folder / 'work', 0
    work.mkdir()
    (folder / 'samples').mkdir()
    for number, sample in enumerate(samples):
        (folder / 'samples' / f'{number}').write_bytes(sample)
    (folder / 'words').write_text(''.join(f'"{word}"\n' for word in decoders.WORDS))
    # What breaks leaves its input there, however it ends this process.
    last, counted = (folder / 'last').open('wb'), (folder / 'count').open('w')

    def once(data: bytes) -> None:
        nonlocal executions
        executions += 1
        for file, content in ((last, data), (counted, str(executions))):
            file.seek(0)
            file.write(content)
            file.truncate()
            file.flush()
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
    (folder / 'problem').write_text(f'took more than {MOST_S:g} s, or {MOST_BYTES / 1e9:g} GB')
    resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
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


if __name__ == '__main__':
    main()
