# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result file may fail; the node then says so once and goes on."""

import errno
from unittest.mock import Mock

from convseq_ros.core.types import Match, Reason, Status
from convseq_ros.errors import ConfigError
from convseq_ros.node.recognition import ResultLog
from convseq_ros.results import read_results, ResultWriter
import pytest


def match(index):
    return Match(index, index, Status.SKIPPED, Reason.WARMING_UP)


def test_rows_are_in_the_file_when_it_is_closed(tmp_path):
    path = tmp_path / 'result.csv'
    log = ResultLog(str(path), Mock())
    log.write(match(0), 1.5)
    log.write(match(1), 2.5)
    log.close()
    assert [row['duration_ms'] for row in read_results(path)] == ['1.500', '2.500']
    assert list(tmp_path.iterdir()) == [path]


def test_a_row_after_the_end_is_left_out(tmp_path):
    path = tmp_path / 'result.csv'
    log = ResultLog(str(path), Mock())
    log.close()
    log.write(match(0), 1.5)
    log.close()
    assert read_results(path) == []


def test_no_file_is_no_trouble():
    log = ResultLog('', Mock())
    log.write(match(0), 1.5)
    log.close()
    assert log.lost == 0


def test_a_folder_that_is_missing_is_one_line(tmp_path):
    path = tmp_path / 'missing' / 'result.csv'
    with pytest.raises(ConfigError, match='No such file or directory') as error:
        ResultLog(str(path), Mock())
    assert str(path) in str(error.value)


def test_a_full_disk_is_told_once_and_counted(tmp_path, monkeypatch):
    logger = Mock()
    log = ResultLog(str(tmp_path / 'result.csv'), logger)
    log.write(match(0), 1.5)
    full = OSError(errno.ENOSPC, 'No space left on device')
    with monkeypatch.context() as patch:
        patch.setattr(ResultWriter, 'write', Mock(side_effect=full))
        log.write(match(1), 1.5)
        log.write(match(2), 1.5)
    log.write(match(3), 1.5)
    log.close()
    assert log.lost == 3
    logger.error.assert_called_once()
    assert 'No space left on device' in logger.error.call_args.args[0]
    assert len(read_results(tmp_path / 'result.csv.part')) == 1
