# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lifelong mode passes over what is known, counts what answers, and keeps its limits."""

from contextlib import closing
from dataclasses import replace
import json
import sqlite3

from convseq_ros.cli import main
from convseq_ros.config import EncodingConfig, make_config
from convseq_ros.core.map.editing import joined, parts_of, write_parts
from convseq_ros.core.map.lifelong import KNOWN, known_as, Sieve
from convseq_ros.core.map.limits import within_limits
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.uses import Use
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Candidate, Frame, Match, Pose, Reason, Status
from convseq_ros.errors import MapError
from convseq_ros.online_config import OnlineConfig
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

pytestmark = pytest.mark.once

DAY, SECOND = 10**15, 10**9
LONG, NEW = 40, range(100, 140)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 4), max_size=120).map(lambda drawn: [each > 0 for each in drawn]))
@example([True] * 16 + [False] * 4)  # only the last three are new, 17 and more after the first
def test_a_sieve_keeps_what_a_fifth_of_the_neighbours_do_not_know(known):
    sieve, found, looks = Sieve(), [], []
    for index, is_known in enumerate(known):
        found += sieve.put(index, index if is_known else None)
    found += sieve.end()
    new = []
    for index in range(len(known)):
        start = max(0, index - KNOWN.window)
        around = known[start : index + KNOWN.window + 1]
        if 5 * around.count(False) > len(around):
            new.append(index)
        before = [one for one in range(start, index + 1) if known[one]]
        looks.append(before[-1] if before and any(around[index - start :]) else None)

    def reach(index):  # what waits at the end is kept up to what is new
        waits = len(known) - index <= 2 * KNOWN.window
        return 2 * KNOWN.window if waits else KNOWN.window

    kept = [
        index
        for index in range(len(known))
        if any(-KNOWN.window <= one - index <= reach(index) for one in new)
    ]
    assert [one.item for one in found] == kept
    assert [one.begins for one in found] == [index - 1 not in kept for index in kept]
    assert [one.look_of for one in found] == [looks[index] for index in kept]


@pytest.mark.parametrize(
    ('status', 'reason', 'known'),
    [
        (Status.ACCEPTED, Reason.ACCEPTED, 7),
        (Status.REJECTED, Reason.COOL_DOWN, 7),
        (Status.REJECTED, Reason.WEAK, None),
        (Status.REJECTED, Reason.AMBIGUOUS, None),
    ],
)
def test_known_is_what_was_accepted_however_low_its_confidence(status, reason, known):
    best = (Candidate(7, 1, 0.25),)
    assert known_as(Match(3, 1, status, reason, best, 2, confidence=0.5)) == known
    assert known_as(None) is None


@pytest.fixture
def drive(tmp_path, image):
    """Return a way to drive past places on a day, and to get the session, closed."""

    def run(day, places, **values):
        config = {'mode': 'lifelong', 'image_size_px': 256, **values}
        session = Session(tmp_path / 'map.db', make_config(config))
        for index, place in enumerate(places):
            pose = Pose((float(index), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            stamp_ns = day * DAY + index * SECOND
            session.recognizer.process(Frame(stamp_ns, image(place, day), '', pose))
            session.save()
        session.close()
        return session

    return run


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'map.db'


def test_the_same_way_adds_nothing_and_a_branch_adds_itself(drive, path, capsys):
    assert drive(1, range(LONG)).added == LONG
    assert drive(2, range(LONG)).added == 0
    first = open_map(path)
    counted = [first.uses[index].answers for index in range(LONG)]
    assert sum(counted) > LONG / 2 and set(counted) == {0, 1}
    assert {first.uses[index].last_ns // DAY for index in range(LONG) if counted[index]} == {2}
    session = drive(3, (*range(LONG), *NEW))
    assert len(NEW) + KNOWN.window <= session.added < LONG + len(NEW)
    whole = open_map(path)
    assert len(whole.sessions) == 2 and len(whole) == LONG + session.added
    firsts = [whole.uses[index].look_of for index in range(LONG, len(whole))]
    led = [index for index in firsts if index is not None]
    assert led and led == sorted(led) and all(index < LONG for index in led)
    assert firsts[-len(NEW) :].count(None) == len(NEW)
    # And it is told.
    assert main(['info', str(path), '--why', '--json']) == 0
    one, two = json.loads(capsys.readouterr().out)['why']
    assert one['new'] == LONG and one['answers'] > sum(counted)
    assert two['new'] == whole.uses.rows(len(whole))[-1:] or two['new'] < session.added
    assert main(['info', str(path), '--why']) == 0
    assert f'0: {LONG} new, 0 looks of places known before;' in capsys.readouterr().out


def test_online_and_preloaded_modes_count_nothing(drive, path):
    drive(1, range(LONG), mode='online')
    assert drive(2, range(LONG), mode='online').added == LONG
    before = path.read_bytes()
    drive(3, range(LONG), mode='preloaded')
    assert path.read_bytes() == before and not len(open_map(path).uses)


def made(path, looks=3, last=(0, 0, 0), size_px=64):
    """Write a map of a way 1 m apart, and looks of it; each look was an answer last at a stamp."""
    whole = ReferenceMap(EncodingConfig(image_size_px=size_px))
    rng = np.random.default_rng(0)
    for look in range(looks):
        whole.begin_session(look, name=f'look {look}')
        for index in range(LONG):
            pose = Pose((float(index), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            place = Place(look * SECOND + index, '', pose, look)
            whole.add(place, rng.random(whole.cell_shape, np.float32).astype(np.float16))
            at = look * LONG + index
            if look:
                whole.uses.looks_like(at, index)
            if last[look]:
                whole.uses.answered(at, last[look])
    save_map(whole, path)
    return whole


def test_a_merged_map_knows_what_its_places_were_good_for(tmp_path):
    paths = tmp_path / 'a.db', tmp_path / 'b.db'
    whole = made(paths[0], looks=2, last=(0, 5)), made(paths[1], last=(0, 0, 7))
    parts = [part for path in paths for part in parts_of(path)]
    write_parts(parts, tmp_path / 'both.db', lambda some: some)
    first, second = (one.uses.rows(len(one)) for one in whole)
    assert first and second
    offset = len(whole[0])
    moved = [(at + offset, replace(use, look_of=use.look_of + offset)) for at, use in second]
    merged = open_map(tmp_path / 'both.db')
    assert merged.uses.rows(len(merged)) == [*first, *moved]
    # So does the map that a fleet links.
    assert joined(parts)[0].reference_map.uses.rows(len(merged)) == [*first, *moved]


def names(path):
    return [session.name for session in open_map(path).sessions]


def test_of_too_many_looks_the_longest_unused_goes_and_the_first_stays(path):
    whole = made(path, last=(0, 5 * SECOND, 0))
    assert open_map(path).uses.rows(120) == whole.uses.rows(120)
    assert within_limits(parts_of(path), OnlineConfig(max_places_per_m=3.0))[1] == 0
    parts, out = within_limits(parts_of(path), OnlineConfig(max_places_per_m=2.0))
    assert out == LONG and names(path) == ['look 0', 'look 1']
    assert [part.name for part in parts] == names(path)
    left = open_map(path)
    assert [left.uses.first(LONG + index) for index in range(LONG)] == [*range(LONG)]
    assert left.uses[LONG] == Use(0, 1, 5 * SECOND)
    assert within_limits(parts_of(path), OnlineConfig(max_places_per_m=0.1))[1] == LONG
    assert names(path) == ['look 0']
    assert within_limits(parts_of(path), OnlineConfig(max_places_per_m=0.1))[1] == 0


def test_a_map_that_is_too_large_is_thinned_when_it_is_opened(path):
    made(path, last=(0, 5 * SECOND, 0), size_px=256)
    size_mb = path.stat().st_size / 1e6
    values = {'mode': 'lifelong', 'image_size_px': 256, 'max_map_mb': 0.8 * size_mb}
    session = Session(path, make_config(values))
    # At most .72 of the places, 86 of 120; of the third session's looks 32 go, then the others.
    assert session.left_out == LONG and len(session.recognizer.reference_map) == 2 * LONG
    assert not session.is_full
    session.recognizer.config = replace(
        session.recognizer.config, online=OnlineConfig('lifelong', max_map_mb=1e-3)
    )
    assert session.is_full
    session.close()
    assert names(path) == ['look 0', 'look 1']


def test_a_full_map_answers_and_does_not_grow(drive, path):
    drive(1, range(LONG))
    session = drive(2, NEW, max_map_mb=1e-3)
    assert session.added == 0 and len(open_map(path)) == LONG and session.is_full
    path.rename(path.with_name('moved.db'))
    assert session.is_full


@pytest.mark.parametrize('mode', ['online', 'preloaded'])
def test_only_lifelong_mode_has_a_limit_to_reach(drive, mode):
    drive(1, range(LONG))
    session = drive(2, range(LONG), mode=mode, max_map_mb=1e-3)
    assert session.added == (LONG if mode == 'online' else 0) and not session.is_full


def test_what_places_were_good_for_goes_with_them_into_other_maps(path, tmp_path):
    made(path, last=(0, 5 * SECOND, 7 * SECOND))
    parts, other = parts_of(path), tmp_path / 'other.db'
    write_parts(parts[1:], other, lambda steps: steps)
    opened = open_map(other)
    assert opened.uses[0] == Use(None, 1, 5 * SECOND)
    assert opened.uses[LONG] == Use(0, 1, 7 * SECOND)


@pytest.mark.parametrize('first', [LONG, 2 * LONG])
def test_a_look_of_what_is_itself_a_look_is_refused(path, first):
    whole = made(path)
    with MapWriter(path, whole.encoding, whole.keyframes, append=True) as writer:
        writer.keep_uses([(2 * LONG, Use(first))])
    values = {'mode': 'lifelong', 'image_size_px': 64, 'max_map_mb': 1e-3}
    with pytest.raises(MapError, match='has a use that cannot be'):
        Session(path, make_config(values))


@pytest.mark.parametrize(
    'change', ['answers = answers + 1', 'look_of = 1000', 'reference_index = -1']
)
def test_a_damaged_use_is_refused(path, change):
    made(path)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f'UPDATE uses SET {change} WHERE reference_index = {LONG}')
    with pytest.raises(MapError, match='damaged map'):
        open_map(path)
