# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every reason shows in the node's table and is counted in its diagnostics."""

from collections import Counter

from convseq_ros.config import EVERY_FRAME
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Reason
from convseq_ros.io.results import read_results
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from sensor_msgs.msg import Image

BEGIN_S = 1000
BLACK, BROKEN, UNKNOWN = 'black', 'broken', 'unknown'
PAIR = {'fixed_length': 2, 'rival_distance': 2}
BELIEF = {'matching': 'coherent'}
ONLINE = {'mode': 'online', 'fixed_length': 1, 'rival_distance': 2}
# Places in the map, parameters, what the camera sees every second, or (second, what) where it is
# another one, and reasons that this gives.
DRIVES = {
    'by the margin': (
        25, PAIR | {'min_margin': 0.05, 'closure_interval_s': 2.0},
        [3, 4, 5, 6, BLACK, BROKEN, (4.5, 9), UNKNOWN, UNKNOWN],
        'warming_up accepted cool_down uninformative unreadable out_of_order ambiguous',
    ),
    # A robot that is put elsewhere may be where it was, or there.
    'by the belief': (
        25, BELIEF | {'min_confidence': 0.99}, [*range(3, 9), 21], 'weak accepted ambiguous',
    ),
    'few places': (6, PAIR | {'rival_distance': 5}, [1, 2], 'warming_up too_few_rivals'),
    'few places, by the belief': (6, BELIEF, [1, 2], 'too_few_rivals'),
    'one place': (1, PAIR, [0, 0], 'warming_up map_too_short'),
    'no place': (0, {}, [0, 0], 'no_map'),
    'a map that grows': (0, ONLINE, [0, 1], 'recent'),
    'a camera too fast': (
        0, ONLINE | {'keyframe_interval_s': 5.0}, [0, 1, 2], 'recent between_keyframes',
    ),
    'a robot that stands': (25, BELIEF, [3, 4, 4, 4], 'weak accepted stationary'),
}  # fmt: skip


@pytest.fixture
def message_of(street, image):
    """Return a maker of messages."""

    def make(what, stamp_s):
        gray = street[what] if isinstance(what, int) else np.zeros_like(street[0])
        if what == UNKNOWN:
            gray = np.random.default_rng(99).integers(0, 256, gray.shape, np.uint8)
        message = image(gray, round((BEGIN_S + stamp_s) * 1e9))
        if what == BROKEN:
            message.step = 3
        return message

    return make


@pytest.mark.parametrize('drive', DRIVES)
def test_a_reason_is_written_to_the_table_and_counted(
    client, vpr, street_map, message_of, tmp_path, drive
):
    count, parameters, views, expected = DRIVES[drive]
    if count:
        part = ReferenceMap(keyframes=EVERY_FRAME)
        for index in range(count):
            part.add(street_map.places[index], street_map.packed(index))
        save_map(part, tmp_path / 'part.db')
        parameters = parameters | {'map_path': tmp_path / 'part.db'}
    table = tmp_path / 'live.csv'
    vpr(result_file=table, diagnostics_period_s=0.1, **parameters)
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    for second, view in enumerate(views):
        stamp_s, what = view if isinstance(view, tuple) else (second, view)
        camera.publish(message_of(what, stamp_s))

    def values():
        return {item.key: item.value for item in diagnostics[-1].status[0].values}

    client.wait_for(lambda: diagnostics and values()['processed'] == str(len(views)), 'answers')
    reasons = [row['reason'] for row in read_results(table)]
    assert set(reasons) >= set(expected.split())
    assert values()['last_reason'] == reasons[-1]
    counted = {
        key.removeprefix('reason_'): int(value)
        for key, value in values().items()
        if key.startswith('reason_')
    }
    assert counted == Counter(reasons)


def test_every_reason_is_tested():
    shown = {reason for *_, expected in DRIVES.values() for reason in expected.split()}
    # One needs odometry that slips: see test/core.
    assert shown | {Reason.IMPLAUSIBLE} == set(Reason)
