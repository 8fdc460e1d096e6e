# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `make demo-relocalise` tells and draws of what the node said."""

import pytest

pytest.importorskip('PIL', reason='needs Pillow, which comes with matplotlib')

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Frame, Pose
from convseq_ros.simulation.drive import Shot
import numpy as np
from PIL import Image, ImageColor
from relocalise import _steps, _table, _told, Told
from scenes import COLOURS, draw_animation, draw_picture

AHEAD = (0.0, 0.0, 0.0, 1.0)
LOST, MAYBE, FOUND = 'lost', 'candidate', 'localised'
STATES = (
    [LOST, LOST, MAYBE, FOUND, FOUND],
    [FOUND, FOUND, LOST, MAYBE, FOUND, FOUND],
    [FOUND] * 4,
)
# Place that is recognised, and where the camera really is.
PLACES = (
    [None, None, 5, 6, 7], [None, None, None, 22, 23, 23], [None] * 4,
)  # fmt: skip
TRUE = ([3.0, 4.0, 5.5, 6.5, 7.5], [20.0, 21.0, 22.0, 22.0, 23.0, 31.0], [40.0, 41.0, 42.0, 43.0])


@pytest.fixture(scope='module')
def steps_and_map():
    reference_map = ReferenceMap()
    noise = np.random.default_rng(1).integers(0, 256, (48, 64), np.uint8)
    descriptor = describe(noise)
    for index in range(50):
        pose = Pose((float(index), 0.1 * index, 0.0), AHEAD)
        reference_map.add_frame(Frame(index + 1, noise, pose=pose), descriptor, 64)
    rows, shots = [], []
    for stay, states in enumerate(STATES):
        for state, place, x in zip(states, PLACES[stay], TRUE[stay], strict=True):
            pose = Pose((x, 0.1 * x, 0.0), AHEAD)
            image = np.full((48, 64, 3), 40 * stay, np.uint8)
            shots.append((stay, Shot(1000 + len(rows), image, pose, x)))
            rows.append(
                {
                    'query_stamp_ns': str(999 + len(shots)),
                    'reference_index': '' if place is None else str(place),
                    'localization': state,
                }
            )
    return _steps(rows, shots, reference_map), reference_map


def test_it_tells_when_it_was_noticed_found_and_how_far_off(steps_and_map):
    steps, _ = steps_and_map
    told = [_told([one for one in steps if one.stay == stay]) for stay in range(3)]
    slope = 1.01**0.5
    assert told[0] == Told(None, 4, pytest.approx(3.5 * slope), pytest.approx(0.5 * slope), 0)
    # The second frame of those that are found again is of a place 8 m away.
    assert (told[1].lost_after, told[1].frames, told[1].wrong) == (3, 5, 1)
    # Nothing was noticed: it was never found here.
    assert (told[2].lost_after, told[2].frames) == (None, None)
    table = _table(told).splitlines()
    assert 'switched on' in table[1] and '4 frames' in table[1] and table[3].count('never') == 2


def test_picture_and_animation_are_drawn(steps_and_map, tmp_path):
    steps, reference_map = steps_and_map
    draw_picture(tmp_path / 'a.png', reference_map, steps)
    draw_animation(tmp_path / 'a.gif', reference_map, steps)
    with Image.open(tmp_path / 'a.png') as picture, Image.open(tmp_path / 'a.gif') as animation:
        assert animation.n_frames == 8
        # One frame of each state is in the strip.
        strip = picture.convert('RGB').crop((0, picture.height - 50, *picture.size))
        found = {colour for _, colour in strip.getcolors(1 << 20)}
    assert {ImageColor.getrgb(one) for one in COLOURS.values()} <= found
