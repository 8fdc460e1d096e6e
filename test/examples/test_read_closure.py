# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`~/closure` as its readers in Python and C++ take it."""

import math
from pathlib import Path
import shutil
import subprocess
import sys
from uuid import UUID

import pytest

pytest.importorskip('sensor_msgs.msg', reason="needs ROS: pip install '.[ros]'")

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Frame, Match, Reason, RelativePose, UNKNOWN_M2
from convseq_ros.node.outputs.closure_messages import CLOSURE, closure_message, LAYOUT
import numpy as np
from read_closure import read_closure, stamp_ns

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
QUERY_NS, REFERENCE_NS = 1_795_355_676_679_518_551, 1_700_000_000_999_999_999
TURN = (0.0, 0.0, math.sin(0.2), math.cos(0.2))
COVARIANCE = np.arange(36.0).reshape(6, 6) / 7
MEASURED = RelativePose(TURN, (1.25, -0.5, 0.125), (0.9, -0.4, 0.1), COVARIANCE, 173)


@pytest.fixture(scope='module')
def reference_map():
    made = ReferenceMap()
    noise = np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)
    for index in range(3):
        made.add_frame(Frame(REFERENCE_NS + index, noise), describe(noise))
    return made


def closure(reference_map, relative_pose=MEASURED, session_start=3):
    best = Candidate(2, REFERENCE_NS, 0.8, inliers=88)
    match = Match(
        41, QUERY_NS, Reason.ACCEPTED, (best,), 5, 9, 0.75,
        relative_pose=relative_pose, overlap=0.625 if relative_pose else None,
    )  # fmt: skip
    return closure_message(match, reference_map, 'base_link', session_start)


def test_python_reads_all_of_it_exactly(reference_map):
    message = closure(reference_map)
    assert message.header.frame_id == 'base_link'
    read = read_closure(message)
    assert stamp_ns(read, 'query') == QUERY_NS
    assert stamp_ns(read, 'reference') == REFERENCE_NS
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(QUERY_NS, 10**9)
    assert (read['query_id'], read['reference_id'], read['inliers']) == (41, 2, 173)
    assert (read['x'], read['y'], read['z']) == MEASURED.position_m
    assert (read['qx'], read['qy'], read['qz'], read['qw']) == TURN
    assert (read['direction'] == MEASURED.direction).all()
    assert (read['covariance'].reshape(6, 6) == COVARIANCE).all()
    assert (read['confidence'], read['overlap'], read['layout']) == (0.75, 0.625, LAYOUT)
    assert UUID(bytes=read['map_id'].tobytes()) == UUID(reference_map.map_id)
    session = UUID(reference_map.sessions[0].id)
    assert UUID(bytes=read['reference_session'].tobytes()) == session
    # The query has a session where the map grows.
    assert not read['query_session'].any()
    growing = read_closure(closure(reference_map, session_start=0))
    assert (growing['query_session'] == read['reference_session']).all()


def test_values_that_are_not_measured_are_not_numbers(reference_map):
    read = read_closure(closure(reference_map, None))
    assert np.isnan([read[name] for name in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')]).all()
    assert np.isnan(read['direction']).all() and read['inliers'] == 88
    assert math.isnan(read['overlap'])
    assert (read['covariance'].reshape(6, 6) == np.eye(6) * UNKNOWN_M2).all()
    turned = RelativePose(TURN, None, (1.0, 0.0, 0.0), COVARIANCE, 40)
    read = read_closure(closure(reference_map, turned))
    assert math.isnan(read['x']) and read['qz'] == TURN[2] and read['direction'][0] == 1.0


def test_another_layout_is_refused(reference_map):
    message = closure(reference_map)
    offset = CLOSURE.fields['layout'][1]
    message.data[offset] = 2
    with pytest.raises(ValueError, match='layout 2'):
        read_closure(message)


def test_every_field_lies_where_its_type_wants_it():
    assert CLOSURE.itemsize % 8 == 0
    for name, (kind, offset) in CLOSURE.fields.items():
        assert offset % kind.base.itemsize == 0, name


def test_cpp_reads_the_same(reference_map, tmp_path):
    headers = Path(sys.prefix) / 'include'
    if not (headers / 'sensor_msgs').is_dir() or not shutil.which('g++'):
        pytest.skip('needs g++ and the C++ headers of sensor_msgs')
    folders = [EXAMPLES / 'closures', *(folder for folder in headers.iterdir() if folder.is_dir())]
    main = Path(__file__).with_name('read_closure_main.cpp')
    command = ['g++', '-std=c++17', *(f'-I{folder}' for folder in folders), main, '-o', 'read']
    subprocess.run(command, cwd=tmp_path, check=True, timeout=200)
    message = closure(reference_map)
    names = '\n'.join(f'{f.name} {f.offset} {f.datatype} {f.count}' for f in message.fields)
    (tmp_path / 'fields').write_text(names)
    (tmp_path / 'data').write_bytes(bytes(message.data))
    read = subprocess.run(
        ['./read', 'fields', 'data'], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    assert [*map(int, read[0].split())] == [5, *divmod(REFERENCE_NS, 10**9)]
    expected = [*MEASURED.position_m, *TURN, *COVARIANCE.ravel()]
    assert [*map(float, read[1].split())] == expected
