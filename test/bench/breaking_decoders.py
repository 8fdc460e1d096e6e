# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz a decoder that breaks in some way at an input that begins with `!`, or one that holds."""

import json
import os
from pathlib import Path
import signal
import sys
import time

from bench.torture import fuzz

BURNT_S = 1.0


def fails():
    raise ZeroDivisionError('on purpose')


def burns():
    until_s = time.process_time() + BURNT_S
    while time.process_time() < until_s:
        pass


ENDS = {'fails': fails, 'dies': lambda: os.kill(os.getpid(), signal.SIGSEGV), 'burns': burns}

if __name__ == '__main__':
    folder = Path(sys.argv[1])
    fuzz.MOST_S, fuzz.FOUND = BURNT_S / 3, folder / 'found'
    known = {
        name: ([b'!0'], lambda given, _, end=end: given[:1] == b'!' and end())
        for name, end in ENDS.items()
    }
    for name, decoder in (known | {'holds': ([b'0'], lambda *_: None)}).items():
        print(json.dumps(fuzz.fuzzed(name, decoder, 100, 0, folder)))
