# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench runs: tiny maps, hardly any rounds, and no look at how long anything takes."""

import json
from pathlib import Path
import subprocess
import sys

from convseq_ros.core.compiled import library
import pytest

from bench.parts.stages import STAGES

REPOSITORY = Path(__file__).resolve().parents[2]
PARTS = {
    'encoding', 'pairs', 'rows', 'frames', 'stages', 'between', 'avx2', 'sequence', 'memory',
    'start', 'node', 'drive',
}  # fmt: skip


@pytest.fixture(scope='module')
def docs(tmp_path_factory):
    folder = tmp_path_factory.mktemp('docs')
    command = [sys.executable, '-m', 'bench', '--quick', '--page', '--docs', str(folder)]
    command += ['--json', str(folder / 'performance.json')]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope='module')
def measured(docs):
    return json.loads((docs / 'performance.json').read_text(encoding='utf-8'))


def rows(measured, part):
    return [row for row in measured['findings'] if row['part'] == part]


def test_every_part_has_findings(measured):
    assert {row['part'] for row in measured['findings']} == PARTS


def test_what_could_not_be_measured_says_why(measured):
    for row in measured['findings']:
        assert row['value'] is not None or row['note'], row


def test_every_target_is_met_or_missed(measured):
    for row in measured['findings']:
        assert (row['met'] is None) == (not row['target']), row


def test_machine_libraries_and_threads_are_told(measured):
    about = measured['about']
    assert about['machine']['cpu'] and about['machine']['cores']
    assert about['machine']['kernels'] == (library().variant or 'none')
    assert {'python', 'numpy'} <= set(about['versions'])
    assert all(row['threads'] >= 1 for row in measured['findings'])


@pytest.mark.parametrize('part', ['pairs', 'rows'])
def test_numpy_is_compared_whether_or_not_there_is_anything_faster(measured, part):
    numpy_rows = [row for row in rows(measured, part) if row['side'] == 'numpy kernel']
    assert numpy_rows and all(row['value'] > 0 for row in numpy_rows)


def test_kernels_and_the_tuned_comparison_score_alike(measured):
    noted = [row for row in rows(measured, 'pairs') if row['note'].startswith('error ')]
    assert {'tuned NumPy', 'released loop', 'numpy kernel'} <= {row['side'] for row in noted}
    for row in noted:
        allowed = 1e-2 if row['side'] == 'int8 kernel' else 1e-5
        assert float(row['note'].split()[1]) <= allowed, row


def test_frames_find_the_place_that_is_in_the_map(measured):
    notes = [row['note'] for row in rows(measured, 'frames') if 'right' in row['note']]
    assert notes and all(note.endswith('3 of 3 right') for note in notes), notes


def test_the_page_holds_the_rows_that_have_a_target(measured, docs):
    page = (docs / 'PERFORMANCE.md').read_text(encoding='utf-8')
    found = [row for row in measured['findings'] if row['target']]
    wanted = [row for row in found if row['part'] != 'rows' or row['threads'] == 1]
    assert wanted and all(f'| {row["what"]} | {row["side"]} |' in page for row in wanted)
    assert 'Not measured' not in page.partition('## On ARM')[0]


def test_every_stage_of_a_frame_is_measured(measured):
    stages = rows(measured, 'stages')
    assert len(stages) == len(STAGES) + 1 and all(row['value'] > 0 for row in stages)
