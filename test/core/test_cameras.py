# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several cameras of one robot, against one map."""

from dataclasses import replace
import math

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.app.cameras import Cameras
from convseq_ros.config import EVERY_FRAME, make_config, with_values
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import base_between, matrix, of_roll_pitch_yaw
from convseq_ros.core.types import Camera, LocalizationState, Reason
from convseq_ros.errors import ConfigError
import numpy as np
import pytest

pytestmark = pytest.mark.once

STEP_NS = 100_000_000
FRONT, REAR = '/front', '/rear'
LENS = Camera(160, 120, 100.0, 100.0, 80.0, 60.0)
MOUNTS = f'1 0 1 0 0 0; -1 0 1 0 0 {math.pi}'
SMALL = make_config({'image_size_px': 256, 'keyframe_overlap': 1.0, 'camera_to_base': MOUNTS})
OWN = with_values(SMALL, {'both_directions': True, 'fixed_length': 8})


@pytest.fixture(scope='module')
def shown(image):
    def frame(number, place, source='', seed=1):
        return Frame(number * STEP_NS, image(place, seed), source, camera=LENS)

    return frame


@pytest.fixture(scope='module')
def reference_map(shown):
    return build_map([shown(number, number, seed=0) for number in range(40)], config=OWN)


def test_cameras_answer_from_their_own_past_and_the_surest_localises(reference_map, shown):
    cameras, frames = Cameras(reference_map, OWN, [FRONT, REAR]), []
    for number in range(24):  # on the way back, the front camera sees nothing known
        frames += [shown(number, 500 + number, FRONT), shown(number, 35 - number, REAR)]
    together = [cameras.process(frame) for frame in frames]
    assert [match.query_index for match in together] == [*range(48)]
    for source in (FRONT, REAR):
        alone = PlaceRecognizer(reference_map, OWN)
        own = [alone.process(frame) for frame in frames if frame.source == source]
        said = [match for match in together if match.camera == source]
        assert [one.reason for one in said] == [one.reason for one in own]
        assert [one.candidates for one in said] == [one.candidates for one in own]
    rear = [match.accepted for match in together[-19::2]]
    assert [one and one.reference_index for one in rear] == list(range(21, 11, -1))
    for match in together[-2:]:
        assert match.localization.state is LocalizationState.LOCALISED
    cameras.reset()
    assert cameras.localization.state is LocalizationState.LOST


def test_the_first_camera_alone_adds_to_a_map(shown):
    online = with_values(OWN, {'mode': 'online'})
    grown = ReferenceMap(OWN.encoding, keyframes=EVERY_FRAME)
    cameras = Cameras(grown, online, [FRONT, REAR])
    for number in range(40):
        cameras.process(shown(number, number, FRONT))
        cameras.process(shown(number, 900 + number, REAR))
    assert len(grown) == 40 and {place.source for place in grown.places} == {FRONT}
    # Of its own drive, the other one recognises the places that the first one may match.
    back = [cameras.process(shown(40 + n, 18 - n, REAR, seed=2)) for n in range(12)]
    assert abs(back[-1].best.reference_index - 7) <= 1
    assert cameras.of(REAR).mapping.usable == cameras.first.mapping.usable == 19


def test_odometry_denies_a_camera_what_contradicts_the_other_one(shown):
    def there(frame, x, yaw):
        return replace(frame, pose=of_roll_pitch_yaw((float(x), 0.0, 0.0), 0.0, 0.0, yaw))

    posed = [there(shown(number, number, seed=0), number, 0.0) for number in range(40)]
    mapped = build_map(posed, config=OWN)
    one = with_values(OWN, {'camera_to_base': '1 0 1 0 0 0'})
    cameras, alone = Cameras(mapped, OWN, [FRONT, REAR]), Cameras(mapped, one, [FRONT])
    said = {REAR: [], FRONT: []}
    for number in range(9):  # until both are said to be near each other
        # What the front camera sees on the way back looks like the way ahead, from place 8 on.
        x, front = 35 - number, shown(number, 8 + number, FRONT)
        said[REAR].append(cameras.process(there(shown(number, x, REAR), x, math.pi)))
        said[FRONT].append(cameras.process(there(front, x, math.pi)))
        last = alone.process(there(front, x, math.pi))
    assert last.accepted and sum(one.accepted is not None for one in said[REAR]) > 6
    assert not any(one.accepted for one in said[FRONT])
    assert said[FRONT][-1].reason is Reason.IMPLAUSIBLE


def test_settings_reach_every_camera(reference_map):
    cameras = Cameras(reference_map, OWN, [FRONT, REAR])
    cameras.configure(with_values(OWN, {'min_confidence': 0.7}))
    for source, x_m in ((FRONT, 1.0), (REAR, -1.0)):
        config = cameras.of(source).config
        assert config.acceptance.min_confidence == 0.7 and config.robot.mount[0] == x_m


def of_mount(config, text, camera=LENS):
    """Return what is said of a camera: the note, and the problem."""
    recognizer = PlaceRecognizer(config, with_values(OWN, {'camera_to_base': text}))
    recognizer.process(Frame(0, np.zeros((12, 16), np.uint8), camera=camera))
    return recognizer.camera_check.note, recognizer.camera_check.problem


def test_the_mount_in_use_is_told_unless_the_frame_has_it():
    empty = ReferenceMap(OWN.encoding)
    assert of_mount(empty, '1 0 1 0 0 0.5') == ('camera_to_base is "1 0 1 0 0 0.5", as given', '')
    note, problem = of_mount(empty, '0 0 0 0 0 0')
    assert note.startswith('camera_to_base is "0 0 0 0 0 0": the base is at the') and not problem
    mounted = replace(LENS, mount=of_roll_pitch_yaw((1.0, 0.0, 1.0), 0.0, 0.0, 0.5))
    assert of_mount(empty, '0 0 0 0 0 0', mounted) == ('', '')
    assert of_mount(empty, '1 0 1 0 0 0.5', None) == ('', '')


@pytest.mark.parametrize(
    ('text', 'is_other'),
    [
        ('1 0 1 0 0 0', False),
        ('1 0.04 1 0 0.03 0', False),  # as calibrations differ
        ('-1 0 1 0 0 3.14', False),  # of the other session
        ('1 0.06 1 0 0 0', True),
        ('1 0 1 0 0.04 0', True),
        ('0 0 0 0 0 0', True),
    ],
)
def test_a_mount_that_no_camera_of_the_map_had_is_a_problem(text, is_other):
    mapped = ReferenceMap(OWN.encoding)
    for x, yaw in ((1.0, 0.0), (-1.0, math.pi)):
        mount = of_roll_pitch_yaw((x, 0.0, 1.0), 0.0, 0.0, yaw)
        mapped.begin_session(0, replace(LENS, mount=mount))
    mapped.begin_session(0, LENS)  # whose mount is unknown
    note, problem = of_mount(mapped, text)
    assert bool(problem) == is_other and not (note and problem)
    if is_other:
        assert problem.startswith(f'camera_to_base is "{text}", and was "-1 0 1 0 0 3.1416" when')


def test_what_is_said_of_several_cameras_has_their_names():
    for sources, told in (([FRONT, REAR], [f'{FRONT}: camera', f'{REAR}: camera']), ([], ['cam'])):
        config = OWN if sources else with_values(OWN, {'camera_to_base': '1 0 1 0 0 0'})
        cameras = Cameras(ReferenceMap(OWN.encoding), config, sources)
        assert cameras.notes == []
        for source in sources or [FRONT]:
            cameras.process(Frame(0, np.zeros((12, 16), np.uint8), source, camera=LENS))
        assert all(note.startswith(said) for note, said in zip(cameras.notes, told, strict=True))
        assert not cameras.problems


def test_the_base_between_cameras_brings_one_mount_onto_the_other():
    front = replace(LENS, mount=of_roll_pitch_yaw((1.0, 0.0, 1.0), 0.0, 0.0, 0.0))
    rear = replace(LENS, mount=of_roll_pitch_yaw((-0.5, 0.0, 1.0), 0.0, 0.0, math.pi))
    moved = base_between(front, rear)
    np.testing.assert_allclose(moved @ matrix(rear.mount), matrix(front.mount), atol=1e-12)
    assert moved[:3, 3] == pytest.approx([0.5, 0.0, 0.0])
    assert np.array_equal(base_between(front, LENS), np.eye(4))


@pytest.mark.parametrize(('sources', 'count'), [((), 1), ((FRONT,), 1), ((FRONT, REAR, '/up'), 3)])
def test_camera_to_base_of_more_or_fewer_cameras_is_refused(reference_map, sources, count):
    with pytest.raises(ConfigError, match=rf'camera_to_base: 2 pose\(s\) for {count} camera'):
        Cameras(reference_map, OWN, sources)
