# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table."""

from convseq_ros.core.types import Candidate, Match, Reason, Status
from convseq_ros.results import COLUMNS, read_results, ResultWriter
import pytest

BEST = Candidate(4, 4000, 0.91234567, (0.5, -2.0), 231)
ACCEPTED = Match(
    3, 3000, Status.ACCEPTED, Reason.ACCEPTED, (BEST,), 7, 100, 0.8, (7.5, -40.0), 0.08
)  # fmt: skip
REJECTED = Match(4, 3100, Status.REJECTED, Reason.AMBIGUOUS, (BEST,), 7, 100)
SKIPPED = Match(5, 3200, Status.SKIPPED, Reason.UNINFORMATIVE)


def test_columns_are_those_that_other_programs_read():
    assert ','.join(COLUMNS) == (
        'query_index,query_stamp_ns,status,reason,reference_index,reference_stamp_ns,score,'
        'confidence,sequence_length,best_index,best_score,shift_rows,shift_cols,pairs_scored,'
        'duration_ms,shift_rows_px,shift_cols_px,relative_yaw_rad,inliers'
    )


def test_rows_round_trip(tmp_path):
    path = tmp_path / 'result.csv'
    with ResultWriter(path) as table:
        for match in (ACCEPTED, REJECTED, SKIPPED):
            table.write(match, 1.5)
    accepted, rejected, skipped = read_results(path)
    assert accepted == dict(
        zip(
            COLUMNS,
            (
                '3',
                '3000',
                'accepted',
                'accepted',
                '4',
                '4000',
                '0.9123457',
                '0.8000',
                '7',
                '4',
                '0.9123457',
                '0.5',
                '-2.0',
                '100',
                '1.500',
                '7.5',
                '-40.0',
                '0.08000',
                '231',
            ),
            strict=True,
        )
    )
    assert rejected['reference_index'] == rejected['score'] == rejected['confidence'] == ''
    assert rejected['best_index'] == '4' and rejected['relative_yaw_rad'] == ''
    assert skipped['best_index'] == '' and skipped['reason'] == 'uninformative'


def test_a_table_under_its_own_name_is_complete_and_an_error_loses_no_row(tmp_path):
    path = tmp_path / 'result.csv'
    path.write_text('older results')
    with pytest.raises(RuntimeError), ResultWriter(path) as table:
        table.write(ACCEPTED, 1.0)
        raise RuntimeError
    assert path.read_text() == 'older results'
    assert len(read_results(tmp_path / 'result.csv.part')) == 1
