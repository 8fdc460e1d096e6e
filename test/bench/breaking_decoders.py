# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz a decoder that breaks in some way at an input that begins with `!`, or one that holds."""

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
    while time.process_time() < BURNT_S:
        pass


ENDS = {'fails': fails, 'dies': lambda: os.kill(os.getpid(), signal.SIGKILL), 'burns': burns}

if __name__ == '__main__':
    fuzz.MOST_S, fuzz.FOUND = BURNT_S / 3, Path(sys.argv[3], 'found')
    known = {
        name: ([b'!0'], lambda given, _, end=end: given[:1] == b'!' and end())
        for name, end in ENDS.items()
    }
    fuzz.main(known | {'holds': ([b'0'], lambda *_: None)})
