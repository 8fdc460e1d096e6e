# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay --mode online`: the map grows from the recording's own past."""

import json

from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.results import read_results
from convseq_ros.sources import open_source
import cv2
import numpy as np
import pytest

ROUND = 10
ONLINE = (
    '--mode', 'online', '--exclusion-s', '0.5', '--fixed-length', '2', '--matching', 'regional',
    '--search', 'exhaustive', '--keyframe-overlap', '1', '--rival-distance', '2',
)  # fmt: skip


def draw(path, places):
    """Write pictures, one every 0.1 s; a place looks alike whenever it is seen."""
    path.mkdir()
    for number, place in enumerate(places):
        rng = np.random.default_rng(place)
        picture = cv2.GaussianBlur(rng.integers(0, 256, (60, 80), np.uint8), (5, 5), 1.0)
        cv2.imwrite(str(path / f'{number:03}.png'), picture)
    return path


@pytest.fixture
def two_rounds(tmp_path):
    return draw(tmp_path / 'rounds', [*range(ROUND), *range(ROUND)])


@pytest.fixture
def replay(tmp_path, capsys):
    """Return a way to run the command and get its summary and its table."""

    def run(recording, path, *args):
        table = tmp_path / 'result.csv'
        code = main(
            ['replay', str(recording), '--map', str(path), '--output', str(table), '--json', *args]
        )
        printed = capsys.readouterr()
        if code:
            return code, printed.err
        return json.loads(printed.out), read_results(table)

    return run


def test_a_recording_that_is_too_short_for_the_exclusion_says_so(two_rounds, tmp_path, capsys):
    words = ['replay', str(two_rounds), '--map', str(tmp_path / 'new.db'), *ONLINE]
    assert main([*words, '--output', str(tmp_path / 'a.csv'), '--exclusion-s', '30']) == 0
    assert 'lasts 1.9 s, and --exclusion-s is 30; set it lower' in capsys.readouterr().err
    assert main([*words, '--output', str(tmp_path / 'b.csv')]) == 0
    assert not capsys.readouterr().err


def test_the_second_round_is_recognised_in_the_first(two_rounds, tmp_path, replay):
    path = tmp_path / 'new.db'
    summary, rows = replay(two_rounds, path, *ONLINE)
    assert summary['added'] == 2 * ROUND
    # The first five frames are younger than half a second, and a sequence has two.
    assert [row['reason'] for row in rows[:5]] == ['recent'] * 5
    accepted = [
        (int(row['query_index']), int(row['reference_index']))
        for row in rows
        if row['reason'] == 'accepted'
    ]
    assert accepted == [(index, index - ROUND) for index in range(ROUND + 1, 2 * ROUND)]
    stamps = [frame.stamp_ns for frame in open_source(two_rounds)]
    assert [place.stamp_ns for place in open_map(path).places] == stamps


def test_preloaded_never_writes(two_rounds, tmp_path, replay):
    path = tmp_path / 'map.db'
    replay(two_rounds, path, *ONLINE)
    before = path.read_bytes()
    summary, _ = replay(two_rounds, path, *ONLINE, '--mode', 'preloaded')
    assert path.read_bytes() == before
    assert summary['added'] == 0
    assert sorted(tmp_path.iterdir()) == [path, tmp_path / 'result.csv', two_rounds]


def test_a_map_that_cannot_be_made_is_one_line_and_exit_1(two_rounds, tmp_path, replay):
    code, errors = replay(two_rounds, tmp_path / 'absent' / 'map.db', *ONLINE)
    assert code == 1
    assert 'absent' in errors and errors.count('\n') == 1
