# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how a map grows that takes in a drive of the same town every day, and is thinned each time.

Usage: python scripts/lifelong.py [--metres 60] [--days 30], some five minutes. Each day's drive,
by day, in the evening, under clouds or at night, up to 1 m to the side of one line, is recognised
in the map of the days before, without odometry, then added as a session and thinned. Right is
within 5 m of where the camera is.
"""

import argparse
from contextlib import redirect_stdout
import io
from pathlib import Path
import sys
import tempfile

from convseq_ros import Config, open_map
from convseq_ros.cli import main as convseq
from convseq_ros.core.map_builder import MapBuilder
from looks import count, Counts, driven
import numpy as np

LIGHTS = ('day', 'evening', 'night', 'overcast')


def told(arguments: list[str]) -> str:
    """Run a command; return what it printed."""
    said = io.StringIO()
    with redirect_stdout(said):
        if convseq(arguments):
            raise SystemExit(1)
    return said.getvalue()


def light_of(day: int) -> str:
    """Return the light of a day: each once, and then as it comes."""
    return LIGHTS[day] if day < len(LIGHTS) else str(np.random.default_rng(day).choice(LIGHTS))


def main() -> int:
    """Drive, recognise, add, thin, and print a row a day."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--metres', type=int, default=60)
    parser.add_argument('--days', type=int, default=30)
    chosen = parser.parse_args()
    print('| day | light | right of keyframes | false | places | sessions |')
    print('|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        whole, merged = Path(folder, 'town.db'), Path(folder, 'merged.db')
        for day in range(chosen.days):
            frames = driven(1, day, light_of(day), chosen.metres)
            counts, own = Counts(), whole if not day else Path(folder, 'day.db')
            if day:
                count(open_map(whole), frames, counts)
            with MapBuilder(own, Config(), name=f'day {day + 1}') as builder:
                for frame in frames:
                    builder.process(frame)
            if day:
                told(['merge', str(whole), str(own), '-o', str(merged)])
                said = told(['thin', str(merged), '--session', f'day {day + 1}'])
                print(said.splitlines()[0], file=sys.stderr)
                merged.replace(whole)
                own.unlink()
            opened = open_map(whole)
            right = f'{counts.right} of {counts.keyframes}'
            row = day + 1, light_of(day), right, counts.wrong, len(opened), len(opened.sessions)
            print('| ' + ' | '.join(map(str, row)) + ' |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
