# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print which files and functions of the package an accepted keyframe enters.

Usage: python scripts/trace_keyframe.py, some seconds. A drawn street is mapped and driven again in
the same light; the last accepted keyframe of the drive is traced, on one thread. Comprehensions
and lambdas count with the function that they stand in; C is not seen.
"""

from collections import Counter
from pathlib import Path
import sys
from types import FrameType
from typing import Any

import convseq_ros
from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
from drives import head, HOUR_NS, options, row

PACKAGE = Path(convseq_ros.__file__).parent


class Trace:
    """Counts the calls of the package's functions while it is on."""

    def __init__(self) -> None:
        self.calls = Counter[tuple[str, str]]()  # by file and function

    def __enter__(self) -> 'Trace':
        sys.setprofile(self._see)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _see(self, frame: FrameType, event: str, _: Any) -> None:
        code, path = frame.f_code, Path(frame.f_code.co_filename)
        if event == 'call' and PACKAGE in path.parents and not code.co_name.startswith('<'):
            self.calls[str(path.relative_to(PACKAGE)), code.co_qualname] += 1


def main() -> None:
    """Drive, trace, and print a row a file."""
    options(__doc__)
    street, config = Street(200.0, 1), make_config({'threads': 1})
    first, again = Drive(seed=1), Drive(seed=2, start_ns=Drive().start_ns + HOUR_NS)
    made = build_map((shot.frame for shot in draw(street, first)), None, config)
    recognizer, accepted = PlaceRecognizer(made, config), Trace()
    for frame in [shot.frame for shot in draw(street, again)]:
        with Trace() as seen:
            match = recognizer.process(frame)
        if match.accepted:
            accepted = seen
    head('file', 'functions', 'calls')
    for file in sorted({file for file, _ in accepted.calls}):
        calls = {name: count for (one, name), count in accepted.calls.items() if one == file}
        row(file, len(calls), sum(calls.values()))
    files = len({file for file, _ in accepted.calls})
    print(f'\n{files} files, {len(accepted.calls)} functions, {accepted.calls.total()} calls')


if __name__ == '__main__':
    main()
