# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links between looks of one place, what they bring near, and that the file keeps them."""

from dataclasses import replace
import tracemalloc

from convseq_ros.app.map_builder import build_map, MapBuilder
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.cli import main
from convseq_ros.config import make_config
from convseq_ros.core.graph.links import chained, Link, LINKS, Links
from convseq_ros.core.graph.neighbourhood import Neighbourhood, SessionBounds
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.session_slice import carry_links
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.rigid import matrix, of_roll_pitch_yaw, turned_by
from convseq_ros.core.types import Camera, Frame, RelativePose
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

pytestmark = pytest.mark.once

SECOND = 10**9
LAP, LAPS = 30, 3
CAMERA = Camera(160, 120, 100.0, 100.0, 80.0, 60.0)


def linked(*pairs, starts=()):
    links = Links(SessionBounds(starts).around)
    for place, other in pairs:
        links.add(place, other)
    return links


def test_a_look_inherits_the_anchor_of_the_place_it_shows():
    links = linked((100, 40), (200, 100), (300, 200), (301, 41))
    anchors = [links.anchor(index) for index in (40, 100, 200, 300, 301, 7)]
    assert anchors == [40, 40, 40, 40, 41, 7]
    assert [*links] == [(100, 40), (200, 40), (300, 40), (301, 41)] and len(links) == 4


def test_places_of_another_session_are_never_neighbours():
    links = linked((50, 48), (52, 10), starts=(50,))
    assert links.looks(48) == (50,)  # two places on, in another session
    assert links.looks(50) == (*range(40, 50),)
    assert links.looks(52) == (*range(2, 19),)


def test_an_existing_link_stays_and_a_link_to_a_later_place_is_refused():
    links = linked((20, 10), (20, 10), (20, 15))
    assert [*links] == [(20, 10)] and len(links.since(0, 21)) == 1
    for other in (20, 21, -1):
        with pytest.raises(ValueError, match=f'place 20 .* place {other},'):
            links.add(20, other)
    # -1 and 99 are no places of the map.
    assert not any(map(links.details, (-1, 99))) and [*map(links.anchor, (-1, 99))] == [-1, 99]
    assert not any(map(links.is_looked_up, (-1, 99)))


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 60), st.integers(0, 59)), max_size=60),
    st.lists(st.integers(1, 60), max_size=3),
)
def test_anchors_are_first_looks_and_looks_are_those_of_all_places(drawn, starts):
    bounds = SessionBounds(tuple(sorted(starts)))
    links = Links(bounds.around)
    for place, other in drawn:
        links.add(place, other) if other < place else links.add_first(place)
    anchors = [links.anchor(index) for index in range(61)]
    assert all(anchors[anchor] == anchor <= at for at, anchor in enumerate(anchors))
    assert dict(links) == {at: anchor for at, anchor in enumerate(anchors) if at != anchor}
    every = np.arange(61)
    for at in range(61):
        # Places that have not come yet do not count as looks: they follow `at` closely.
        shown = bounds.near(np.array(anchors), anchors[at], LINKS.reach)
        found = every[shown & ~bounds.near(every, at, LINKS.neighbour_radius)]
        assert links.looks(at) == (*(int(one) for one in found),)


def measured(x, yaw, scale=1.0):
    pose = of_roll_pitch_yaw((x, 0.1 * x, 0.0), 0.0, 0.0, yaw)
    root = np.random.default_rng(7).random((6, 6)) * 0.1 * scale
    covariance = root @ root.T + 1e-4 * np.eye(6)
    return RelativePose(pose.orientation, pose.position, (1.0, 0.0, 0.0), covariance, 30)


def told(link):
    """Return all that a link says, to be compared."""
    pose = link.relative
    numbers = pose and (pose.orientation, pose.position_m, pose.direction, pose.inliers)
    covariance = pose and pose.covariance.tolist()
    fields = link.place, link.other, link.anchor, link.confidence, link.inliers
    return *fields, numbers, covariance, pose and pose.explains


def test_links_keep_all_that_a_back_end_asks_for_through_a_file(a_map, path):
    whole = a_map(40)
    no_scale = replace(measured(1.0, 0.2), position_m=None, explains=False)
    whole.links.add(20, 10, 0.97, 41, measured(1.0, 0.2))
    whole.links.add(30, 20, 0.99, 40, no_scale)
    whole.links.add(35, 11)
    whole.links.add_first(36)
    expected = (20, 10, 10, 0.97, 41), (30, 20, 10, 0.99, 40), (35, 11, 11, None, None)
    assert [told(one)[:5] for one in whole.links.each()] == [*expected]
    save_map(whole, path)
    opened = open_map(path)
    assert [*map(told, opened.links.each())] == [*map(told, whole.links.each())]
    assert opened.links.details(36) is opened.links.details(10) is None
    assert not opened.problem and opened.links.looked_up_count == 4


@pytest.mark.parametrize(('is_link', 'most'), [(True, 400), (False, 40)])
def test_a_link_takes_400_bytes_of_memory_and_a_place_without_one_40(is_link, most):
    links, count = linked(), 2000
    tracemalloc.start()
    for place in range(count, 2 * count):
        if is_link:
            links.add(place, place - count, 0.97, 41, measured(1.0, 0.2))
        else:
            links.add_first(place)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < most * count and links.looked_up_count == count
    if is_link:
        assert told(links.details(count))[:5] == (count, 0, 0, 0.97, 41)


def test_a_link_to_a_removed_place_leads_to_the_place_behind_it(a_map):
    whole = a_map(40)
    whole.links.add(20, 10, 0.97, 41, measured(1.0, 0.2))
    whole.links.add(30, 20, 0.99, 40, measured(2.0, -0.1))
    whole.links.add(31, 30, 0.98, 39)
    whole.links.add(35, 31, 0.95, 38, measured(2.0, -0.1))
    without = [(whole, at) for at in range(40) if at not in (20, 31)]
    left = Links(whole.bounds.around)
    carry_links(without, left)
    past, beside = left.details(29), left.details(33)
    assert (past.other, past.anchor, past.confidence, past.inliers) == (10, 10, 0.97, 40)
    expected = matrix(measured(1.0, 0.2).pose) @ matrix(measured(2.0, -0.1).pose)
    assert np.allclose(matrix(past.relative.pose), expected)
    assert (beside.other, beside.anchor, beside.relative) == (29, 10, None)


def test_the_covariance_of_two_steps_is_what_drawn_steps_scatter_by():
    rng, one, two = np.random.default_rng(0), measured(2.0, -0.4), measured(1.0, 0.5, 0.5)
    one, two = (replace(each, covariance=1e-2 * each.covariance) for each in (one, two))
    mean = matrix(two.pose) @ matrix(one.pose)

    def drawn(pose):
        moved, error = matrix(pose.pose), rng.multivariate_normal([0] * 6, pose.covariance)
        moved[:3, :3] = turned_by(error[3:]) @ moved[:3, :3]
        moved[:3, 3] += error[:3]
        return moved

    errors = []
    for _ in range(4000):
        moved = drawn(two) @ drawn(one)
        turn = cv2.Rodrigues(moved[:3, :3] @ mean[:3, :3].T)[0][:, 0]
        errors.append([*(moved - mean)[:3, 3], *turn])
    both = chained(Link(3, 2, 1, relative=one), Link(2, 1, 1, relative=two)).relative
    assert np.allclose(matrix(both.pose), mean)
    scatter = np.cov(np.array(errors).T)
    assert np.abs(scatter - both.covariance).max() < 0.1 * np.abs(scatter).max()


def laps(image, seed=0):
    shown = [image(index % LAP, seed=seed + index) for index in range(LAPS * LAP)]
    return [Frame(at * SECOND, one, camera=CAMERA) for at, one in enumerate(shown)]


def config(**values):
    return make_config({'image_size_px': 128, **values})


def is_right(place, other):
    return abs((place - other + LAP // 2) % LAP - LAP // 2) <= 2


def test_a_map_that_was_built_has_the_places_and_links_of_one_grown_online(tmp_path, image):
    built = build_map(laps(image), None, config())
    bare = build_map(laps(image), None, config(), links=False)
    pipeline = Pipeline(tmp_path / 'grown.db', config(mode='online'))
    for frame in laps(image):
        pipeline.recognizer.process(frame)
    pipeline.close()
    grown = open_map(tmp_path / 'grown.db')
    assert [*map(told, built.links.each())] == [*map(told, grown.links.each())]
    assert len(built.links) > LAP / 2
    assert built.is_linked and grown.is_linked
    assert all(is_right(*pair) for pair in built.links)
    for other in (grown, bare):
        assert [*other.places] == [*built.places]
        assert all((other.packed(at) == built.packed(at)).all() for at in range(len(built)))
    assert not bare.is_linked and not bare.links.looked_up_count


def test_stamps_that_jump_back_make_no_other_places(image):
    frames = [replace(one, stamp_ns=(at % LAP) * SECOND) for at, one in enumerate(laps(image))]
    with_links, without = (build_map(frames, None, config(), links) for links in (True, False))
    assert [*with_links.places] == [*without.places] and len(with_links.sessions) == 1


def test_laps_are_linked_alike_in_one_session_and_in_three(tmp_path, image):
    path, frames = tmp_path / 'map.db', laps(image)
    for start in range(0, len(frames), LAP):
        with MapBuilder(path, config(), append=start > 0) as builder:
            for frame in frames[start : start + LAP]:
                builder.process(frame)
    one, three = build_map(frames, None, config()), open_map(path)
    assert len(three.sessions) == LAPS
    for made in (one, three):
        assert all(is_right(*pair) for pair in made.links)
    # In one session, too few other places are old enough until the drive is half a lap further.
    late = {*range(LAP + LAP // 2 + 2, LAPS * LAP)}
    linked = [dict(made.links).keys() for made in (one, three)]
    assert all(len(late & places) > 0.8 * len(late) for places in linked)
    assert len(late & (linked[0] ^ linked[1])) < 0.15 * len(late)


def test_merging_links_maps_to_one_another_unless_no_links_is_given(tmp_path, image):
    *paths, merged, bare = (str(tmp_path / name) for name in ('0.db', '1.db', 'merged', 'bare'))
    for number, one in enumerate(paths):
        build_map(laps(image, 300 * number)[:LAP], one, config())
    assert main(['map', 'merge', *paths, '-o', merged]) == 0
    assert main(['map', 'merge', *paths, '-o', bare, '--no-links']) == 0
    opened = open_map(merged)
    assert opened.is_linked and len(opened.links) > LAP / 2
    assert all(other < LAP <= place and is_right(place, other) for place, other in opened.links)
    assert not open_map(bare).is_linked and not len(open_map(bare).links)


def test_places_beside_a_place_and_beside_its_looks_are_near(a_map):
    whole = a_map(40, 40)
    whole.links.add(60, 20)
    near = Neighbourhood(whole)
    assert near.is_near(63, 60, 3) and not near.is_near(64, 60, 3)
    # Looks of 60 are 12 to 28: anchors within eight of its own.
    for place, is_near in ((9, True), (8, False), (31, True), (32, False), (39, False)):
        assert near.is_near(place, 60, 3) is is_near
    assert near.is_near(57, 28, 3) and not near.is_near(56, 28, 3)
    assert not near.is_near(60, 5, 3)


def test_places_of_another_session_are_never_near(a_map):
    near = Neighbourhood(a_map(10, 10))
    assert near.is_near(9, 8, 4) and not near.is_near(10, 9, 4)
    assert near.mask(np.arange(20), 10, 4).nonzero()[0].tolist() == [*range(10, 15)]


@settings(max_examples=60)
@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=4),
    st.integers(0, 99),
    st.integers(0, 12),
    st.integers(0, 119),
)
def test_the_mask_of_near_places_is_that_of_each_place(a_map, lengths, seed, distance, index):
    whole, rng = a_map(*lengths), np.random.default_rng(seed)
    for place in range(1, len(whole)):
        if rng.random() < 0.4:
            whole.links.add(place, int(rng.integers(place)))
    near, index = Neighbourhood(whole), index % len(whole)
    places = np.flatnonzero(rng.random(len(whole)) < 0.7)
    said = [near.is_near(one, index, distance) for one in places.tolist()]
    assert near.mask(places, index, distance).tolist() == said
    assert near.is_near(index, index, distance)
