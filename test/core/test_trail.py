# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where odometry had a robot, in a map file: written as it drives, damaged, and edited."""

from contextlib import closing
from dataclasses import replace
import math
import sqlite3

from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.core.map.online import OnlineMap
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Anchor, Candidate, Frame, Match, Pose, Reason, RelativePose
import numpy as np
from pictures import scene
from poses import at
import pytest

from bench.torture.maps import APART, cells, ENCODING

pytestmark = pytest.mark.once
SECOND = 10**9
RELATIVE = RelativePose((0, 0, 0, 1), (0.5, 0, 0), None, np.eye(6), 12, True)


def keyframe(number: int, session: str, **known: object) -> Keyframe:
    pose = Pose((np.float64(number / 3), -0.0, 1.0), (0.0, 0.0, 0.0, 1.0), (0.1, math.nan))
    return Keyframe(session, number * SECOND, pose, **known)


def made(count: int = 3, sessions: int = 2) -> ReferenceMap:
    """Return a map whose places are keyframes, and of whose sessions the last closes a loop."""
    whole = ReferenceMap(ENCODING)
    for session in range(sessions):
        whole.begin_session(session)
        own = whole.sessions[-1].id
        for number in range(count):
            whole.add(Place(number * SECOND, session=session), cells(number))
            whole.trail.add(keyframe(number, own))
    other = Anchor(whole.sessions[0].id, SECOND)
    whole.trail.add(keyframe(count, own, other=other, relative=RELATIVE))  # not a place
    return whole


def rows(of: ReferenceMap) -> list[tuple]:
    return [
        (one.session_id, one.stamp_ns, one.pose, repr(one.pose.variances), one.other)
        + ((one.relative.position_m, one.relative.inliers) if one.relative else ())
        for one in of.trail.since(0)
    ]


def test_a_trail_is_opened_as_it_was_saved(path):
    save_map(whole := made(), path)
    assert rows(open_map(path)) == rows(whole) and len(open_map(path).trail) == 7


def test_keyframes_are_written_as_they_come_and_then_released(path):
    owner = Appender(path, ENCODING, APART)
    growing = owner.reference_map
    growing.begin_session(0)
    own = growing.sessions[0].id
    growing.trail.add(keyframe(0, own))
    owner.flush()  # before any place
    assert rows(open_map(path)) == rows(growing) and not growing.trail.since(1)
    for number in (1, 2):
        growing.trail.add(keyframe(number, own))
    owner.save()
    owner.close()
    again = Appender(path, ENCODING, APART, append=True)
    again.reference_map.trail.add(keyframe(3, own))
    again.close()
    assert [one.stamp_ns // SECOND for one in open_map(path).trail.since(0)] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    'change',
    ['x = 1e9', 'qw = 2.0', "session = 'other'", 'stamp_ns = 8', 'relative = zeroblob(8)',
     "metres2 = 'many'", 'other_ns = NULL'],
)  # fmt: skip
def test_a_keyframe_that_is_damaged_is_left_out_and_the_others_stay(path, change):
    save_map(whole := made(), path)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f'UPDATE keyframes SET {change} WHERE number = 6')
    assert rows(open_map(path)) == rows(whole)[:6]


def test_a_trail_on_damaged_pages_is_no_trail_and_the_map_opens(path):
    save_map(made(), path)
    with closing(sqlite3.connect(path)) as database:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'keyframes'"
        (page,) = database.execute(query).fetchone()
    content = bytearray(path.read_bytes())
    content[(page - 1) * PAGE_BYTES : page * PAGE_BYTES] = b'\xff' * PAGE_BYTES
    path.write_bytes(content)
    opened = open_map(path)
    assert len(opened) == 6 and opened.trail.since(0) == []


def test_edits_carry_the_trail_of_the_sessions_that_stay(path, tmp_path):
    save_map(whole := made(), path)
    one, other = slices_of(path)
    for kept, expected in (((one, other), slice(7)), ((one,), slice(3)), ((other,), slice(3, 7))):
        save_map(joined(kept), tmp_path / 'new.db', is_new=True)
        assert rows(open_map(tmp_path / 'new.db')) == rows(whole)[expected]
        (tmp_path / 'new.db').unlink()
    # Poses that replace those by odometry are no odometry.
    replaced = replace(one, poses={0: Pose((0, 0, 0), (0, 0, 0, 1))})
    assert rows(joined([replaced, other])) == rows(whole)[3:]


# What online mode adds.


def frames(count: int, variances: tuple[float, float] | None, first: int = 0) -> list[Frame]:
    poses = [replace(at(x), variances=variances) for x in range(count)]
    shown = [scene(x, seed=first, size=(64, 64)) for x in range(count)]
    return [Frame((first + x) * SECOND, shown[x], pose=poses[x]) for x in range(count)]


def test_each_keyframe_with_odometry_is_in_the_trail_and_poses_of_files_are_not(path):
    config = make_config({'image_size_px': 64})
    with MapBuilder(path, config) as builder:
        for frame in frames(10, (0.2, 0.1)):
            builder.process(frame)
    opened = open_map(path)
    trail = opened.trail.since(0)
    assert [(one.stamp_ns, one.pose) for one in trail] == [
        (place.stamp_ns, place.pose) for place in opened.places
    ]
    assert {one.pose.variances for one in trail} == {(0.2, 0.1)}
    assert {one.session_id for one in trail} == {opened.sessions[0].id}
    with MapBuilder(path, config, append=True) as builder:
        for frame in frames(10, None):
            builder.process(frame)
    assert len(open_map(path).trail) == len(trail) and len(open_map(path)) > len(trail)


def test_a_keyframe_that_is_no_place_is_in_the_trail_with_what_it_closes(monkeypatch):
    whole = made(sessions=1)
    mapping = OnlineMap(whole, make_config({'mode': 'online'}))
    monkeypatch.setattr(mapping, '_skips', lambda *_: True)  # its place has enough looks
    (frame,) = frames(1, (0.2, 0.1), 100)
    best = Candidate(1, SECOND, 0.9, session=0)
    found = Match(0, frame.stamp_ns, Reason.ACCEPTED, (best,), relative_pose=RELATIVE)
    refused = replace(found, reason=Reason.WEAK, relative_pose=None)
    for match in (found, refused):
        mapping.add(frame, describe(frame.gray, ENCODING), match)
    one, other = whole.trail.since(4)
    assert len(whole) == 3 and len(whole.sessions) == 2
    assert one.session_id == other.session_id == whole.sessions[1].id
    assert one.other == Anchor(whole.sessions[0].id, SECOND) and one.relative is RELATIVE
    assert other.other is None and other.relative is None
