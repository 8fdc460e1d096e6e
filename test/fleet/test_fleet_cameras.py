# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps of two cameras, with kept images and depth, is as one map merged from them."""

from convseq_ros.cli import main
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.fleet.fleet import Fleet
import pytest
from two_cameras import COUNT, DEPTH, record_two_cameras, TOPICS

BOTH = '--topic', ' '.join(TOPICS)
KEPT = '--keep-images-px', '40', '--depth', DEPTH, '--keyframe-overlap', '1'


@pytest.fixture(scope='module')
def maps(tmp_path_factory, scheduler):
    """Return a folder of recordings, one of their maps, and one map merged from these."""
    pytest.importorskip('rosbags')
    folder, made = tmp_path_factory.mktemp('recorded'), tmp_path_factory.mktemp('made')
    for number in range(2):
        record_two_cameras(folder / f'drive_{number}', 1000 * number)
    wanted = 'fleet', 'build', str(folder), '-o', str(made), '--scheduler', scheduler
    assert main([*wanted, *BOTH, *KEPT]) == 0
    one = tmp_path_factory.mktemp('one') / 'one.db'
    parts = [str(path) for path in sorted(made.glob('*.db'))]
    assert main(['map', 'merge', *parts, '-o', str(one), '--no-links']) == 0
    return folder, made, one


def test_maps_are_those_of_build_map(maps, tmp_path):
    folder, made, _ = maps
    own = tmp_path / 'own.db'
    assert main(['build-map', str(folder / 'drive_1'), str(own), *BOTH, *KEPT]) == 0
    own, built = open_map(own), open_map(made / 'drive_1.db')
    assert [one.name for one in own.sessions] == [one.name for one in built.sessions]
    assert [*own.places] == [*built.places] and len(own) == 2 * COUNT
    kept = [
        [(one.image, one.depths) for one in each.pictures(range(len(own)), True)]
        for each in (own, built)
    ]
    assert kept[0] == kept[1] and all(image for image, _ in kept[0])


def test_workers_send_images_and_depths(maps, client):
    _, made, one = maps
    session, merged = Fleet(client, sorted(made.glob('*.db')), Config()), open_map(one)
    asked = [0, COUNT, 3 * COUNT - 1, 2 * COUNT]
    whole = session.cameras.first.reference_map.pictures(asked, True)
    assert [(each.image, each.depths) for each in whole] == [
        (each.image, each.depths) for each in merged.pictures(asked, True)
    ]
    assert all(each.image for each in whole)
    assert [each.depths is not None for each in whole] == [True, False, True, True]
    assert not session.cameras.first.reference_map.pictures(asked)[0].image
