# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench runs: tiny maps, hardly any rounds, and no look at how long anything takes."""

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


@pytest.fixture(scope='module')
def docs(tmp_path_factory):
    folder = tmp_path_factory.mktemp('docs')
    command = [sys.executable, '-m', 'bench', '--quick', '--page', '--docs', str(folder)]
    command += ['--json', str(folder / 'performance.json')]
    done = run(*command, cwd=REPOSITORY)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope='module')
def measured(docs):
    return json.loads((docs / 'performance.json').read_text(encoding='utf-8'))


def rows(measured, part):
    return [row for row in measured['findings'] if row['part'] == part]


def test_every_part_has_findings(measured):
    assert {row['part'] for row in measured['findings']} == {*PARTS}


def test_what_could_not_be_measured_says_why(measured):
    for row in measured['findings']:
        assert row['value'] is not None or row['note'], row


def test_machine_peaks_clock_and_libraries_are_told(measured):
    about = measured['about']
    assert about['machine']['cpu'] and about['machine']['cores']
    assert about['machine']['kernels'] == (library().variant or 'none')
    assert 0.1 < about['machine']['clock_ghz'] < 10
    assert {'python', 'numpy'} <= set(about['versions'])
    peaks = [row for row in rows(measured, 'kernels') if row['what'].startswith('peak')]
    peaks = [row for row in peaks if not row['kernels']]
    assert len(peaks) == 2 and peaks[0]['value'] > 0


def test_kernels_score_alike(measured):
    noted = [row for row in rows(measured, 'kernels') if row['note'].startswith('error ')]
    assert 'numpy kernel' in {row['side'] for row in noted}
    for row in noted:
        allowed = 1e-2 if row['side'] == 'int8 kernel' else 1e-5
        assert float(row['note'].split()[1]) <= allowed, row


def test_frames_find_the_place_that_is_in_the_map(measured):
    whole = [row for row in rows(measured, 'frames') if row['side'] == 'whole']
    assert whole and all(row['note'].endswith('3 of 3 right') for row in whole), whole


def test_the_split_and_the_stages_are_a_whole_frame(measured):
    frame = {row['side']: row['value'] for row in rows(measured, 'frames')}
    assert {*STAGES} <= {*frame} and frame['operations'] > 0 and frame['pairs in full'] > 0
    split = frame['scales with the integer peak'] + frame['scales with the clock']
    assert split == pytest.approx(frame['whole'])


def test_the_page_has_robots_and_all_rows_with_a_target(measured, docs):
    page = (docs / 'PERFORMANCE.md').read_text(encoding='utf-8')
    wanted = [row for row in measured['findings'] if is_met(row) is not None]
    assert wanted and all(f'| {row["what"]} | {row["side"]} |' in page for row in wanted)
    assert all(f'| {name} |' in page for name in ROBOTS) or not library().variant
    assert 'Not measured' not in page
