# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz decoders that break: `breaking_decoders.py FOLDER` ends with 0 if each is seen."""

import os
from pathlib import Path
import signal
import sys
import time

from bench.torture import _fuzzer
from bench.torture.decoders import Decoder

BURNT_S = 1.0


def fails():
    raise ZeroDivisionError('on purpose')


def burns():
    while time.process_time() < BURNT_S:
        pass


def main(folder):
    """Check that each end is seen and its input kept, and that what holds is fuzzed to the end."""
    _fuzzer._FOUND, _fuzzer.MOST_S = folder / 'found', BURNT_S / 3
    ends = {b'!0': fails, b'!1': lambda: os.kill(os.getpid(), signal.SIGKILL), b'!2': burns}
    for data, end in ends.items():
        broken = Decoder([data], lambda given, _, end=end: given[:1] == b'!' and end())
        _fuzzer.decoders.decoders = lambda broken=broken: {'a b': broken}
        executions, problem = next(_fuzzer.fuzz('a b', 100, 0, folder))
        assert executions < 100, (data, executions)
        kept = folder / 'found' / problem.split('; ')[-1]
        assert kept.read_bytes() == data, problem
    _fuzzer.decoders.decoders = lambda: {'holds': Decoder([b'0'], lambda *_: None)}
    assert [*_fuzzer.fuzz('holds', 50, 0, folder)] == [(50, '')]


if __name__ == '__main__':
    main(Path(sys.argv[1]))
