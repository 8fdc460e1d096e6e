# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench runs to its end and finds what it must: how fast, nobody asks here."""

import json
from pathlib import Path
import sys

from convseq_ros.core.compiled import library
from programs import run
import pytest

from bench.finding import is_met
from bench.page import ROBOTS
from bench.part import PARTS
from bench.parts.frames import STAGES

REPOSITORY = Path(__file__).resolve().parents[2]


def test_every_part_measures_and_the_page_is_written(tmp_path):
    command = [sys.executable, '-m', 'bench', '--quick', '--best-kernels', '--page', '--docs']
    done = run(*command, tmp_path, '--json', tmp_path / 'performance.json', cwd=REPOSITORY)
    assert done.returncode == 0, done.stderr
    measured = json.loads((tmp_path / 'performance.json').read_text(encoding='utf-8'))
    by_part = {name: [] for name in PARTS}
    for row in measured['findings']:
        by_part[row['part']].append(row)
        assert row['value'] is not None or row['note'], row
    assert all(by_part.values())
    assert 0.1 < measured['about']['machine']['clock_ghz'] < 10

    noted = {row['side']: row['note'] for row in by_part['kernels'] if 'error ' in row['note']}
    assert 'numpy kernel' in noted
    for side, note in noted.items():
        assert float(note.split()[1]) <= (1e-2 if side == 'int8 kernel' else 1e-5), side

    whole = [row for row in by_part['frames'] if row['side'] == 'whole']
    assert whole and all(row['note'].endswith('3 of 3 right') for row in whole), whole
    frame = {row['side']: row['value'] for row in by_part['frames']}
    assert {*STAGES} <= {*frame} and frame['operations'] > 0 and frame['pairs in full'] > 0
    split = frame['scales with the integer peak'] + frame['scales with the clock']
    assert split == pytest.approx(frame['whole'])

    page = (tmp_path / 'PERFORMANCE.md').read_text(encoding='utf-8')
    wanted = [row for row in measured['findings'] if is_met(row) is not None]
    assert wanted and all(f'| {row["what"]} | {row["side"]} |' in page for row in wanted)
    assert all(f'| {name} |' in page for name in ROBOTS) or not library().variant
    assert 'Not measured' not in page
