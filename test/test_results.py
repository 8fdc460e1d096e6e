# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table."""

from pathlib import Path

from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.core.types import (
    Anchor,
    Candidate,
    Localization,
    LocalizationState,
    Match,
    Reason,
    RelativePose,
)
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.provenance import short
from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.io.results import read_results, ResultWriter
import numpy as np
import pytest

SURE = RelativePose(
    (0.0, 0.0, 0.0, 1.0), (1.0, -0.25, 0.0), None, np.diag([0.04, 0.01, 0.01, 1, 1, 0.0004]), 300
)
BEST = Candidate(4, 4000, 0.91234567, (0.5, -2.0), 231)
ACCEPTED = Match(
    3, 3000, Reason.ACCEPTED, (BEST,), 7, 100, 0.8, (7.5, -40.0), 0.08,
    SURE, localization=Localization(LocalizationState.LOCALISED, 0.8, 4), camera='/rear/image',
    anchor=Anchor('monday', 1000), overlap=0.75,
)  # fmt: skip
REJECTED = Match(4, 3100, Reason.AMBIGUOUS, (BEST,), 7, 100)
SKIPPED = Match(5, 3200, Reason.UNINFORMATIVE)


def test_a_result_table_is_read_as_it_was_written(tmp_path):
    path = tmp_path / 'result.csv'
    with ResultWriter(path, COLUMNS) as table:
        for match in (ACCEPTED, REJECTED, SKIPPED):
            table.write(row(match, 1.5))
    accepted, rejected, skipped = read_results(str(path))
    assert ','.join(accepted.values()) == (
        '3,3000,accepted,accepted,4,4000,0.9123457,0.8000,7,4,0.9123457,0.5,-2.0,100,1.500,7.5,'
        '-40.0,0.08000,231,localised,0.8000,1.0000,-0.2500,0.0000,0.000000,0.000000,0.000000,'
        '1.000000,0.2000,0.02000,,0,/rear/image,monday,1000,,0.750'
    )
    empty = 'reference_index', 'score', 'confidence', 'relative_yaw_rad'
    assert rejected['best_index'] == '4' and not any(rejected[name] for name in empty)
    empty = 'localization', 'localization_quality', 'best_index', 'session'
    assert skipped['reason'] == 'uninformative' and not any(skipped[name] for name in empty)


def test_a_row_is_in_the_file_once_it_is_written_and_an_error_loses_none(tmp_path):
    path = tmp_path / 'result.csv'
    path.write_text('older results')
    with pytest.raises(RuntimeError), ResultWriter(path, COLUMNS) as table:
        table.write(row(ACCEPTED, 1.0))
        assert len(read_results(path)) == 1
        raise RuntimeError
    assert len(read_results(path)) == 1 and [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize('content', [b'query_index\n\xff\n', b'query_index\n' + b'1' * 200_000])
def test_a_file_that_is_no_result_table_is_refused(tmp_path, content):
    (tmp_path / 'result.csv').write_bytes(content)
    with pytest.raises(SourceError, match=r'result.csv: not a result table'):
        read_results(tmp_path / 'result.csv')


def test_tables_of_earlier_runs_are_kept_if_that_is_wanted(tmp_path):
    path = tmp_path / 'result.csv'
    for run in range(3):
        with ResultWriter(path, COLUMNS, keeps_earlier=True) as table:
            for _ in range(run):
                table.write(row(ACCEPTED, 1.0))
    tables = [tmp_path / name for name in ('result.1.csv', 'result.2.csv', 'result.csv')]
    assert [len(read_results(one)) for one in tables] == [0, 1, 2]
    assert sorted(tmp_path.iterdir()) == tables


def test_an_error_names_the_file():
    with pytest.raises(OSError, match=r'No space left.*/dev/full'):
        ResultWriter(Path('/dev/full'), COLUMNS)


def test_a_result_file_is_complete_or_absent_and_replaces_no_other_file(tmp_path):
    path, part = tmp_path / 'page.html', tmp_path / 'page.html.part'
    part.write_text('of the user')
    with pytest.raises(RuntimeError), complete_or_absent(path) as own:
        own.write_text('half')
        raise RuntimeError
    assert list(tmp_path.iterdir()) == [part]
    with complete_or_absent(path) as own:
        own.write_text('whole')
    assert (path.read_text(), part.read_text()) == ('whole', 'of the user')
    assert path.stat().st_mode == part.stat().st_mode and len(list(tmp_path.iterdir())) == 2


def test_a_page_tells_the_commit_in_short_and_whether_the_tree_was_changed():
    number = '8cc3058e' + 'a' * 32
    assert [short(number), short(f'{number}-dirty')] == ['8cc3058e', '8cc3058e-dirty']
    assert short(None) == 'an unknown commit'
