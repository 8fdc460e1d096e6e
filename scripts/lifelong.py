# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how a map grows that a robot drives with every day in lifelong mode.

Usage: python scripts/lifelong.py [--metres 60] [--days 30] [--max-places-per-m 2.5] [--town 1],
some five minutes. Each day's drive, by day, in the evening, under clouds or at night, up to 1 m to
the side of one line, with odometry, is recognised in the map of the days before, and what is new
of it is added. Right is within 5 m of where the camera is. `left out` are places that went when
the map was opened, to keep the limit.
"""

import argparse
from pathlib import Path
import sys
import tempfile

from convseq_ros.config import make_config
from convseq_ros.core.session import Session
from looks import count, Counts, driven
import numpy as np

LIGHTS = ('day', 'evening', 'night', 'overcast')


def light_of(day: int) -> str:
    """Return the light of a day: each once, and then as it comes."""
    return LIGHTS[day] if day < len(LIGHTS) else str(np.random.default_rng(day).choice(LIGHTS))


def main() -> int:
    """Drive, recognise, add, thin, and print a row a day."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--metres', type=int, default=60)
    parser.add_argument('--days', type=int, default=30)
    parser.add_argument('--max-places-per-m', type=float, default=0.0)
    parser.add_argument('--town', type=int, default=1)
    chosen = parser.parse_args()
    limit = {'max_places_per_m': chosen.max_places_per_m}
    config = make_config({'mode': 'lifelong', **limit})
    print('| day | light | right of keyframes | false | left out | places | sessions |')
    print('|---|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        for day in range(chosen.days):
            frames = driven(chosen.town, day, light_of(day), chosen.metres)
            counts = Counts()
            session = Session(Path(folder, 'town.db'), config)
            count(session.recognizer, frames, counts)
            session.close()
            own = session.recognizer.reference_map
            right = f'{counts.right} of {counts.keyframes}'
            told = light_of(day), right, counts.wrong, session.left_out, len(own)
            row = day + 1, *told, len(own.sessions)
            print('| ' + ' | '.join(map(str, row)) + ' |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
