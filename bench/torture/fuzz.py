# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzzes every decoder with Atheris: libFuzzer, guided by the lines of Python that are reached."""

from collections.abc import Callable, Iterator
import contextlib
from importlib.util import find_spec
import io
from pathlib import Path
import shutil
import sys
import tempfile
import time
from typing import Any, NoReturn

import cv2

from bench.torture.attack import Try
from bench.torture.forked import BLOCKED_S, ended, MOST_BYTES, MOST_S

MISSING = '' if find_spec('atheris') else "Atheris is missing; run: pip install '.[torture]'"
FOUND = Path(tempfile.gettempdir(), 'convseq_fuzz')  # inputs that break a decoder
_MOST_S = 3600  # of the CPU, for all inputs of a decoder
_MOST_ERROR = 2000  # characters of an error
# Values for wrong places in a text, in addition to those of the fuzzer.
_WORDS = ['9' * 30, *'-1 1e308 nan inf 1e99999999 [] {} 0x ~ &a *a !!'.split()]


def fuzz(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Fuzz every decoder so many times."""
    if MISSING:
        raise SystemExit(f'fuzz: {MISSING}')
    import atheris

    # Atheris prints every module that it instruments.
    with (
        contextlib.redirect_stderr(io.StringIO()),
        atheris.instrument_imports(include=['convseq_ros']),
    ):
        from bench.torture.decoders import decoders
    cv2.setNumThreads(1)
    for name, decoder in decoders().items():
        yield fuzzed(name, decoder, count, seed, folder)


def fuzzed(name: str, decoder: Any, count: int, seed: int, folder: Path) -> Try:
    """Fuzz a decoder in a fork of this process, and keep the input that breaks it."""
    with tempfile.TemporaryDirectory(dir=folder) as made:
        end = ended(lambda: _be_libfuzzer(decoder, count, seed, Path(made)), _MOST_S)
        if not end.problem:
            return Try(name, made=count)
        FOUND.mkdir(exist_ok=True)
        kept = FOUND / f'{name.replace(" ", "_")}-{seed}'
        for one in Path(made).glob('crash-*'):
            shutil.copy(one, kept)
        return Try(name, f'{end.problem}; {kept}')


def _be_libfuzzer(decoder: Any, count: int, seed: int, folder: Path) -> NoReturn:
    """Fuzz a decoder until it fails; libFuzzer then writes the input into the folder."""
    import atheris

    samples, decode = decoder
    work = folder / 'work'
    (folder / 'samples').mkdir()
    for number, sample in enumerate(samples):
        (folder / 'samples' / f'{number}').write_bytes(sample)
    (folder / 'words').write_text(''.join(f'"{word}"\n' for word in _WORDS))

    def once(data: bytes) -> None:
        work.mkdir()
        try:
            _decode_once(decode, data, work)
        except BaseException:
            (folder / 'crash-of-python').write_bytes(data)
            raise
        shutil.rmtree(work)

    options = [
        f'-runs={count}',
        f'-seed={seed}',
        f'-timeout={BLOCKED_S}',
        f'-rss_limit_mb={MOST_BYTES // 10**6}',
        f'-dict={folder / "words"}',
        f'-artifact_prefix={folder}/crash-',
    ]
    atheris.Setup(['fuzz', *options, str(folder / 'samples')], once)
    sys.exit(atheris.Fuzz())  # it ends this process itself


def _decode_once(decode: Callable[[bytes, Path], object], data: bytes, work: Path) -> None:
    from convseq_ros.errors import ConvseqError

    begun_s = time.process_time()
    try:
        decode(data, work)
    except ConvseqError as error:
        if len(str(error)) > _MOST_ERROR:
            raise
    # libFuzzer's own limit is of wall-clock time, which includes other programs.
    if time.process_time() - begun_s > MOST_S:
        raise TimeoutError(f'took more than {MOST_S} s')
