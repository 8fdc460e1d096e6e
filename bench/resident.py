# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Opens one map in this process, uses it, and prints what that took as JSON."""

import argparse
import json
from pathlib import Path
import re
import time

from convseq_ros.config import Config
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame
import numpy as np

_PERIOD_NS = 100_000_000


def main() -> None:
    """Open the map, process every image once, and tell."""
    parser = argparse.ArgumentParser()
    parser.add_argument('map', type=Path)
    parser.add_argument('images', type=Path, help='gray images, npy')
    chosen = parser.parse_args()
    images = np.load(chosen.images, mmap_mode='r')  # only its head: what is mapped is resident
    _, height, width = images.shape
    start_s = time.perf_counter()
    Session(None, Config()).warm_up()
    warm_s = time.perf_counter() - start_s
    before_mb = _resident_mb('VmRSS')
    start_s = time.perf_counter()
    session = Session(chosen.map, Config())
    open_s = time.perf_counter() - start_s
    session.warm_up()
    for number in range(len(images)):
        begin = images.offset + number * height * width
        image = np.fromfile(chosen.images, np.uint8, height * width, offset=begin)
        frame = Frame(number * _PERIOD_NS, image.reshape(height, width))
        session.recognizer.process(frame)
    print(
        json.dumps(
            {
                'open_s': open_s,
                'warm_s': warm_s,
                'before_mb': before_mb,
                'resident_mb': _resident_mb('VmRSS'),
                'most_mb': _resident_mb('VmHWM'),
            }
        )
    )


def _resident_mb(name: str) -> float:
    status = Path('/proc/self/status').read_text(encoding='ascii')
    found = re.search(rf'{name}:\s+(\d+) kB', status)
    assert found
    return int(found[1]) / 1e3


if __name__ == '__main__':
    main()
