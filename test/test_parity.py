# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live node and the core alone give the same answers to the same recording."""

from dataclasses import replace
import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')
pytest.importorskip('mcap')

from convseq_ros.app.cameras import Cameras
from convseq_ros.app.map_builder import build_map
from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.first_stage import with_first_stage
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame
from convseq_ros.io.mask_file import read_mask
from convseq_ros.io.results import read_results, ResultWriter
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources import open_source
import cv2
from descriptor_models import made
import numpy as np
from pictures import scene
from programs import run, wait_for
import recordings
from world import map_of

START_NS, STEP_NS = recordings.START_NS, recordings.STEP_NS
NUM_FRAMES = 36
STEPS_PX = [2] * 8 + [60] * 8 + [20] * 8 + [1] * 12
BLACK, UNREADABLE, LATE, JUMP = 5, 13, 21, 28
ONLINE = {'mode': 'online', 'keyframe_overlap': 1.0}


@pytest.fixture(scope='module')
def drive():
    """Return views of a wall, driven past slowly and fast, so that k varies."""
    noise = np.random.default_rng(11).integers(0, 256, (120, 1000), np.uint8)
    wall = cv2.GaussianBlur(noise, (7, 7), 2.0)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    starts = np.cumsum(STEPS_PX) - STEPS_PX[0]
    views = [wall[:, start : start + 160] for start in starts]
    # Large enough that Fast DDS acknowledges them at once, not every 3 s.
    return [cv2.resize(view, (320, 240), interpolation=cv2.INTER_NEAREST) for view in views]


@pytest.fixture(scope='module')
def encoding(tmp_path_factory):
    """Return that of a camera upside down, before which the robot hides what is at the bottom."""
    mask = np.full((60, 80), 255, np.uint8)
    mask[:6] = 0
    path = tmp_path_factory.mktemp('parity') / 'mask.png'
    cv2.imwrite(str(path), mask)
    return EncodingConfig(image_mask=str(path), image_rotation_deg=180)


@pytest.fixture(scope='module')
def map_path(drive, encoding, tmp_path_factory):
    encoding = configured(encoding).encoding
    upright = (cv2.rotate(cv2.GaussianBlur(one, (3, 3), 0), cv2.ROTATE_180) for one in drive)
    path = tmp_path_factory.mktemp('parity') / 'wall.db'
    save_map(map_of((describe(one, encoding) for one in upright), encoding), path)
    return path


@pytest.fixture(scope='module')
def recording(drive, tmp_path_factory):
    """Return a recording with a black, an unreadable and a late image and a jump of the clock."""
    rows = []
    for index, gray in enumerate(drive):
        stamp_ns = START_NS + index * STEP_NS
        stamp_ns -= 2 * STEP_NS if index == LATE else 0
        stamp_ns -= 25 * STEP_NS if index >= JUMP else 0
        pixels = np.zeros_like(gray) if index == BLACK else gray
        changes = {'step': 3} if index == UNREADABLE else {}
        message = recordings.image(pixels, stamp_ns, **changes)
        rows.append(('/camera', START_NS + index * STEP_NS, message))
    folder = tmp_path_factory.mktemp('parity')
    return recordings.write_recording(folder, 'mcap folder', rows)


def configured(encoding):
    """Return a configuration whose mask is read."""
    config = Config(encoding=encoding)
    return masked(config, read_mask(config))


def answers_of_the_core(recording, map_path, encoding, path, topics):
    config = configured(encoding)
    model = open_model(config)
    config = with_first_stage(config, model)
    source = open_source(recording, reading=config.reading)
    if map_path.is_file():
        given = open_map(map_path, config.encoding), config
    else:
        config = with_values(config, ONLINE)
        given = build_map([], None, config), config
    recognizer = PlaceRecognizer(*given, describe=model)
    if topics:
        recognizer = Cameras(*given, topics)
    with ResultWriter(path, COLUMNS) as writer:
        for topic in topics or ['']:
            for frame in source:
                writer.write(row(recognizer.process(replace(frame, source=topic)), 0.0))
    return read_results(path)


def answers_of_the_node(recording, map_path, encoding, path, topics, expected):
    parameters = {
        'map_path': map_path, 'result_file': path, 'queue_size': 1000, 'max_wait_s': 0.0,
        'image_mask': encoding.image_mask, 'image_rotation_deg': encoding.image_rotation_deg,
        'descriptor_model': encoding.descriptor_model, 'image_topics': ' '.join(topics),
        **({} if map_path.is_file() else ONLINE),
    }  # fmt: skip
    given = [f'{name}:={value}' for name, value in parameters.items() if value != '']
    words = ['--ros-args', *(word for one in given for word in ('-p', one))]
    python = [sys.executable, '-m']
    ours = {'cwd': path.parent, 'env': os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)}}
    with subprocess.Popen([*python, 'convseq_ros.node.vpr_node', *words], **ours) as node:
        try:
            for topic in topics or ['/image']:
                sender = 'convseq_ros.node.outputs.drive_sender', recording, '6'
                done = run(*python, *sender, f'/camera:={topic}', **ours, timeout=180)
                assert done.returncode == 0, done.stderr
            wait_for(lambda: len(path.read_text().splitlines()) > expected, 60)
            node.send_signal(signal.SIGINT)
            assert node.wait(60) == 0
        finally:
            node.kill()
    return read_results(path)


def same_answers(folder, recording, map_path, encoding, topics=()):
    """Return what the core says, once the node has said the same."""
    given = recording, map_path, encoding
    # A map that grows has a session of a new id.
    passing = {'duration_ms'} if map_path.is_file() else {'duration_ms', 'anchor_session'}
    offline = answers_of_the_core(*given, folder / 'core.csv', topics)
    live = answers_of_the_node(*given, folder / 'node.csv', topics, len(offline))
    for line in (*offline, *live):
        for name in passing:
            del line[name]
    assert live == offline
    return offline


def test_the_live_node_answers_as_the_core(recording, map_path, encoding, tmp_path):
    given = recording, map_path, encoding
    offline = same_answers(tmp_path, *given)
    assert len(offline) == NUM_FRAMES
    # The drive must be worth the comparison.
    reasons = {row['reason'] for row in offline}
    assert {'accepted', 'uninformative', 'unreadable', 'out_of_order', 'weak'} <= reasons
    assert len({row['sequence_length'] for row in offline}) > 3
    assert {row['localization'] for row in offline} >= {'candidate', 'localised'}


@pytest.mark.once
def test_a_live_node_with_a_model_answers_as_the_core(recording, drive, encoding, tmp_path):
    made(tmp_path / 'net.onnx', 'random')
    encoding = replace(encoding, descriptor_model=str(tmp_path / 'net.onnx'))
    config = replace(configured(encoding), keyframes=EVERY_FRAME)
    frames = [
        Frame((index + 1) * STEP_NS, cv2.GaussianBlur(gray, (3, 3), 0))
        for index, gray in enumerate(drive)
    ]
    build_map(frames, tmp_path / 'wall.db', config, describe=open_model(config))
    given = recording, tmp_path / 'wall.db', encoding
    offline = same_answers(tmp_path, *given)
    assert sum(row['reason'] == 'accepted' for row in offline) > NUM_FRAMES / 4


@pytest.mark.once
def test_a_live_node_with_two_cameras_answers_as_the_core(recording, map_path, encoding, tmp_path):
    topics = ['/front/image', '/rear/image']
    offline = same_answers(tmp_path, recording, map_path, encoding, topics)
    shown = [topic for topic in topics for _ in range(NUM_FRAMES)]
    assert [row['camera'] for row in offline] == shown


@pytest.mark.once
def test_a_live_node_whose_map_grows_answers_as_the_core(tmp_path):
    """It passes other places, stands before a view that people pass, and sees the first again."""
    places, (view,) = ([scene(one, 0, (320, 240)) for one in some] for some in (range(30), [99]))
    crowd = []
    for at in range(50):
        crowd.append(view.copy())
        cv2.rectangle(crowd[-1], (at * 37 % 320, 60), (at * 37 % 320 + 60, 240), at * 5, -1)
    rows = [
        ('/camera', START_NS + at * STEP_NS, recordings.image(one, START_NS + at * STEP_NS))
        for at, one in enumerate([*places, *crowd, *places[3:9]])
    ]
    recording = recordings.write_recording(tmp_path, 'mcap folder', rows)
    offline = same_answers(tmp_path, recording, tmp_path / 'map.db', EncodingConfig())
    reasons = [row['reason'] for row in offline]
    assert 'recent' in reasons[60:80] and 'accepted' not in reasons[:80]
    assert {*reasons[80:]} == {'accepted'}
