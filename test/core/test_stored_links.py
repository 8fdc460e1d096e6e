# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links in a map file: how they are written, damaged and edited."""

from contextlib import closing
import sqlite3

from convseq_ros.app.map_builder import not_linked
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.cli import main
from convseq_ros.config import make_config
from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.format import PAGE_BYTES, row_crc
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of, without
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError
import numpy as np
import pytest

from bench.torture.maps import APART, cells, ENCODING

pytestmark = pytest.mark.once


def grow(reference_map, count, session=0):
    for index in range(len(reference_map), len(reference_map) + count):
        reference_map.add(Place(index, session=session), cells(index))


def made(count, *pairs):
    reference_map = ReferenceMap(ENCODING)
    grow(reference_map, count)
    for place, other in pairs:
        reference_map.links.add(place, other)
    return reference_map


def own(path):
    return Appender(path, ENCODING, APART)


def test_links_are_written_with_their_places_or_later_and_never_before(path):
    owner = own(path)
    whole = owner.reference_map
    grow(whole, 20)
    whole.links.add(15, 2)
    owner.flush()
    assert [*open_map(path).links] == [(15, 2)]
    whole.links.add(12, 3)  # of a place that is safe already
    owner.flush()
    assert [*open_map(path).links] == [(12, 3), (15, 2)]
    whole.links.add(22, 4)  # of one that is still to come
    owner.flush()
    assert len(open_map(path).links) == 2
    grow(whole, 5)
    owner.close()
    assert [*open_map(path).links] == [(12, 3), (15, 2), (22, 4)]
    again = own(path)
    again.reference_map.links.add(24, 15)
    again.close()
    assert [*open_map(path).links] == [(12, 3), (15, 2), (22, 4), (24, 2)]


UNTURNED = np.array([0, 0, 0, 2, *[1] * 29], '<f8').tobytes()
NONE = None, None, None


@pytest.mark.parametrize(
    'row',
    [(place, other, 0, *NONE) for place, other in ((15, 15), (15, 16), (15, -1), (15, 10**12))]
    + [(place, other, 0, *NONE) for place, other in ((15, 'text'), (20, 3), (-1, 3), (10**12, 0))]
    + [(15, 3, anchor, *NONE) for anchor in (4, -1, None, 'text', 1.5)]
    + [(15, 3, 3, *said) for said in ((2.0, 1, None), ('a', 1, None), (0.5, 'a', None))]
    + [(15, 3, 3, 0.5, 9, measured) for measured in (b'', b'1234567', bytes(264), UNTURNED)],
)
def test_impossible_links_are_left_out_and_reported_once(path, row, capsys):
    whole = made(20, (12, 2), (18, 3))
    save_map(whole, path)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute('INSERT INTO links VALUES (?, ?, ?, ?, ?, ?, ?)', (*row, row_crc(row)))
    opened = open_map(path)
    assert [*opened.links] == [(12, 2), (18, 3)]
    assert opened.problem == f'{path}: 1 links are damaged and left out; all the rest works'
    assert main(['info', str(path)]) == 0
    said = capsys.readouterr()
    assert 'links        2' in said.out and said.err == f'warning: {opened.problem}\n'
    pipeline = Pipeline(path, make_config({'image_size_px': 64}))
    assert pipeline.ignored[:1] == [opened.problem]


def page_of_links(path):
    """Return where the page of the links of a small map begins in its file."""
    with closing(sqlite3.connect(path)) as database:
        ((root,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'links'")
    return (root - 1) * PAGE_BYTES


def zero(content, page):
    content[page : page + PAGE_BYTES] = bytes(PAGE_BYTES)


def circle(content, page):
    content[page + 10 : page + 12] = content[page + 8 : page + 10]  # the second row is the first


def reorder(content, page):
    row = page + int.from_bytes(content[page + 10 : page + 12], 'big')  # the second one
    assert content[row + 1] == 14
    content[row + 1] = 78


MILLION = (
    'WITH RECURSIVE c(x) AS (SELECT 20 UNION ALL SELECT x + 1 FROM c LIMIT 1000000) '
    'INSERT INTO links SELECT x, x - 1, 0, NULL, NULL, NULL, 0 FROM c'
)


@pytest.mark.parametrize(
    ('damage', 'left', 'told'),
    [
        (MILLION, [(12, 2), (14, 3), (18, 3)], '1000000 links are damaged'),
        ('UPDATE links SET other = 1 WHERE place = 12', [(14, 3), (18, 3)], '1 links are damaged'),
        (reorder, [(12, 2)], '2 links are damaged'),
        (circle, [], 'from 0 on are damaged'),
        (zero, [], 'from 0 on are damaged'),
    ],
)
def test_damage_costs_links_and_no_place_and_is_counted_in_one_line(path, damage, left, told):
    save_map(made(20, (12, 2), (14, 3), (18, 3)), path)
    if isinstance(damage, str):
        with closing(sqlite3.connect(path)) as database, database:
            database.execute(damage)
    else:
        content = bytearray(path.read_bytes())
        damage(content, page_of_links(path))
        path.write_bytes(content)
    opened = open_map(path)
    assert [*opened.links] == left
    assert told in opened.problem and opened.problem.endswith(' left out; all the rest works')
    owner = own(path)
    grow(owner.reference_map, 3)
    owner.reference_map.links.add(21, 4)
    owner.close()
    opened = open_map(path)
    assert len(opened) == 23 and (opened.packed(22) == cells(22)).all()


def test_editing_keeps_links_among_the_places_that_stay(path, tmp_path):
    whole = ReferenceMap(ENCODING)
    for session in range(3):
        whole.begin_session(0)
        grow(whole, 20, session)
    for place, other in ((25, 5), (45, 5), (26, 6), (50, 30)):
        whole.links.add(place, other)
    for index in range(60):
        whole.links.add_first(index)
    save_map(whole, path)
    parts, other = slices_of(path), tmp_path / 'other.db'
    save_map(joined(parts[1:]), other, is_new=True)  # the first session, with anchors, goes
    left = open_map(other)
    assert [*left.links] == [(25, 5), (30, 10)] and left.is_linked
    left = joined(without(parts, [25]))
    assert [*left.links] == [(25, 6), (44, 5), (49, 29)] and left.is_linked


def test_what_a_person_unlinked_stays_so_in_an_edited_map_and_in_no_map_that_exists(path):
    whole = made(20, (15, 3), (16, 4))
    whole.links.add_unlinked(17)
    save_map(whole, path)
    left = joined(without(slices_of(path), [2]))
    assert [at for at in range(19) if left.links.is_unlinked(at)] == [16]
    before = path.read_bytes()
    with pytest.raises(MapError, match='exists'):
        save_map(left, path, is_new=True)
    assert path.read_bytes() == before


def test_places_merged_from_another_map_still_need_link_search(tmp_path):
    paths = [tmp_path / 'a.db', tmp_path / 'b.db']
    for one in paths:
        whole = made(20, (15, 3))
        for index in range(20):
            whole.links.add_first(index)
        save_map(whole, one)
    merged = joined([part for one in paths for part in slices_of(one)])
    assert [*merged.links] == [(15, 3), (35, 23)]
    assert not merged.is_linked and not_linked(merged) == [range(20, 40)]
