# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps answers as one map would that was made of all."""

from pathlib import Path
import shutil

from convseq_ros.cli import main
from convseq_ros.config import Config, make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.errors import FleetError, MapError
from convseq_ros.fleet.fleet import Fleet
import pytest

FRAMES = 20
SETTINGS = '--keyframe-overlap', '1'
SETTINGS_OF_ANSWERS = (
    {},
    {'both_directions': True},
    {'fixed_length': 10, 'acceptance_rule': 'margin'},
    {'matching': 'regional'},
    {'search': 'exhaustive'},
)


@pytest.mark.parametrize('asked', SETTINGS_OF_ANSWERS)
def test_a_fleet_answers_every_frame_as_one_map(drives, answers_of, asked):
    maps, one, again = drives
    config = make_config(asked)
    fleet = Fleet(sorted(maps.glob('*.db')), config)
    found = answers_of(fleet.cameras.first, again)
    assert found == answers_of(PlaceRecognizer(open_map(one), config), again)
    assert fleet.missing == [] and len(fleet.reference_map) == 3 * FRAMES
    assert any(reason == 'accepted' for _, reason, *_ in found)


def test_a_fleet_keeps_links_keypoints_and_kept_images_of_its_maps(drives, tmp_path, answers_of):
    maps, _, again = drives
    paths = [shutil.copy(path, tmp_path) for path in sorted(maps.glob('*.db'))]
    assert main(['build-map', str(again), str(paths[1]), *SETTINGS, '--append']) == 0
    one, parts = tmp_path / 'one' / 'one.db', [str(path) for path in paths]
    one.parent.mkdir()
    assert main(['map', 'merge', *parts, '-o', str(one), '--no-links']) == 0
    fleet, merged = Fleet([*map(Path, paths)], Config()), open_map(one)
    linked = [*fleet.reference_map.links]
    assert linked == [*merged.links] and len(linked) > FRAMES // 2
    assert [*fleet.reference_map.places] == [*merged.places]
    asked = [0, FRAMES, len(merged) - 1, 2 * FRAMES]
    for with_images in (False, True):
        ours, theirs = (
            [
                (each.packed.tobytes(), each.keypoints, each.image)
                for each in one.pictures(asked, with_images)
            ]
            for one in (fleet.reference_map, merged)
        )
        assert ours == theirs and (ours[0][2] is not None) == with_images and ours[0][1]
    expected = answers_of(PlaceRecognizer(merged, Config()), again)
    assert answers_of(fleet.cameras.first, again) == expected


def test_maps_that_cannot_be_opened_are_left_out_and_named(drives, expected, tmp_path, answers_of):
    maps, _, again = drives
    folder = shutil.copytree(maps, tmp_path / 'some')
    (folder / 'map_0a.db').write_bytes(b'SQLite format 3\0 and nothing else')
    other = ['--image-size-px', '256']
    assert main(['build-map', str(again), str(folder / 'map_9.db'), *SETTINGS, *other]) == 0
    fleet = Fleet(sorted(folder.glob('*.db')), Config())
    damaged, foreign = fleet.missing
    assert 'map_0a.db' in damaged and 'map_9.db' in foreign and 'image_size_px' in foreign
    # The others answer as if there were no more; without any, there is no fleet.
    assert answers_of(fleet.cameras.first, again) == expected
    with pytest.raises(FleetError, match=r'no map of 1 can be opened: .*map_0a\.db'):
        Fleet([folder / 'map_0a.db'], Config())


def test_a_map_that_is_damaged_later_ends_in_one_line(drives, tmp_path, answers_of):
    maps, _, again = drives
    folder = shutil.copytree(maps, tmp_path / 'some')
    fleet, damaged = Fleet(sorted(folder.glob('*.db')), Config()), folder / 'map_1.db'
    content = damaged.read_bytes()
    quarter = len(content) // 4
    damaged.write_bytes(content[:quarter] + bytes(len(content) - quarter))
    with pytest.raises(MapError, match=r'map_1\.db') as caught:
        answers_of(fleet.cameras.first, again)
    assert '\n' not in str(caught.value)


def test_a_fleet_that_is_to_grow_is_refused(drives):
    with pytest.raises(FleetError, match=r'mode online: .*; leave it out'):
        Fleet(sorted(drives[0].glob('*.db')), make_config({'mode': 'online'}))
