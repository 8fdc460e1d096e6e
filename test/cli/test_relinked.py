# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links of a map that is there: taken out, made again, limited, counted and drawn."""

import json
from unittest.mock import Mock

from convseq_ros.app.map_builder import not_linked
from convseq_ros.cli import main, map_link
from convseq_ros.cli import map as map_command
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
import numpy as np
import pytest

ROUND = 32


@pytest.fixture
def path(tmp_path):
    """Return a map of three rounds."""
    return in_rounds(tmp_path / 'map.db', 3)


def in_rounds(path, rounds):
    """Make a map of some rounds, a session each, of which all but the first are linked."""
    rng, whole = np.random.default_rng(0), ReferenceMap()
    cells = rng.random((ROUND, 32, 32, 8)).astype(np.float16)
    for number in range(rounds):
        whole.begin_session(number * 10**12, name=f'round {number}')
        for at in range(ROUND):
            index = len(whole)
            whole.add(Place(number * 10**12 + at, session=number), cells[at])
            if number:
                whole.links.add(index, index - ROUND, 0.95, 40)
            else:
                whole.links.add_first(index)
    save_map(whole, path)
    return path


def test_a_removed_link_stays_removed_and_the_links_that_hung_on_it_remain(path, capsys):
    assert main(['map', 'unlink', str(path), '--place', str(ROUND + 5)]) == 0
    assert '1 of 64 links taken out' in capsys.readouterr().out
    left = open_map(path)
    assert len(left.links) == 63 and left.links.anchor(ROUND + 5) == ROUND + 5
    # The look of the third round hung on it, and has a new anchor; the others' stay.
    assert left.links.anchor(2 * ROUND + 5) == ROUND + 5
    assert left.links.anchor(2 * ROUND + 6) == 6
    assert left.is_linked and not not_linked(left)
    assert left.links.details(ROUND + 6).confidence == 0.95


def test_linking_again_replaces_all_links_but_those_that_were_taken_out(path, monkeypatch, capsys):
    assert main(['map', 'unlink', str(path), '--place', str(ROUND + 5)]) == 0
    assert main(['map', 'unlink', str(path), '--place', str(ROUND + 6)]) == 0
    assert main(['map', 'remove', str(path), '--session', 'round 2']) == 0  # marks are carried on
    kept = [open_map(path).links.is_unlinked(at) for at in range(2 * ROUND)]
    assert kept == [at in (ROUND + 5, ROUND + 6) for at in range(2 * ROUND)]
    before = path.read_bytes()
    assert main(['map', 'link', str(path)]) == 0 and path.read_bytes() == before
    with monkeypatch.context() as patch:
        patch.setattr(map_link, 'link', Mock(side_effect=KeyboardInterrupt))
        assert main(['map', 'link', str(path), '--again'])
    assert path.read_bytes() == before
    capsys.readouterr()
    assert main(['map', 'link', str(path), '--again', '--json']) == 0
    links = json.loads(capsys.readouterr().out)
    linked = {one['place'] for one in links}
    assert linked > {*range(ROUND + 10, 2 * ROUND)} and linked.isdisjoint((ROUND + 5, ROUND + 6))
    assert all(one['other'] == one['place'] - ROUND for one in links)
    assert all(one['confidence'] != 0.95 for one in links)  # that of the links before
    again = open_map(path)
    assert again.is_linked and again.links.is_unlinked(ROUND + 5)


def test_links_are_removed_by_session_or_all_at_once(path, capsys):
    assert main(['map', 'unlink', str(path), '--session', 'round 2']) == 0
    left = open_map(path)
    assert {place for place, _ in left.links} == {*range(ROUND, 2 * ROUND)}
    assert main(['map', 'unlink', str(path)]) == 0
    left = open_map(path)
    assert not len(left.links) and len(not_linked(left)) == 3
    assert '32 of 32 links taken out; convseq map link' in capsys.readouterr().out


def test_merging_with_max_looks_writes_the_map_once_without_surplus(path, monkeypatch, capsys):
    merged, write = path.with_name('merged.db'), Mock(side_effect=save_map)
    monkeypatch.setattr(map_command, 'save_map', write)
    assert main(['map', 'merge', str(path), '-o', str(merged), '--max-looks', '2']) == 0
    assert '64 keyframes' in capsys.readouterr().out and write.call_count == 1
    assert main(['map', 'remove', str(path), '--max-looks', '2']) == 0
    left, expected = open_map(merged), open_map(path)
    assert [*left.places] == [*expected.places] and [*left.links] == [*expected.links]


def test_a_merged_map_keeps_eight_looks_of_a_place_by_default(tmp_path):
    path = in_rounds(tmp_path / 'map.db', 10)
    for asked, kept in ((), 8), (('--max-looks', '0'), 10):
        merged = tmp_path / f'{kept}.db'
        assert main(['map', 'merge', str(path), '-o', str(merged), *asked]) == 0
        assert len(open_map(merged)) == kept * ROUND


def test_info_counts_places(path, capsys):
    assert main(['info', str(path)]) == 0
    told = '96 keyframes, 32 places, each passed 3.0 times; 64 links, 64 between'
    assert told in capsys.readouterr().out
