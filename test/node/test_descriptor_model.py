# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node with a descriptor model says what it costs, and goes on when it fails."""

from itertools import count
import re
import time

from convseq_ros.app.map_builder import build_map
from convseq_ros.config import Config, EVERY_FRAME
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Frame
from convseq_ros.errors import MapError, ModelError
from convseq_ros.models.onnx_model import OnnxModel
from descriptor_models import made
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from sensor_msgs.msg import Image

SECOND = 1_000_000_000
PERIOD = {'diagnostics_period_s': 0.1}


@pytest.fixture
def net(tmp_path):
    return made(tmp_path / 'net.onnx', 'hog', 64, 128)


@pytest.fixture
def net_map(net, street, tmp_path):
    frames = [Frame((index + 1) * SECOND, gray) for index, gray in enumerate(street[:25])]
    config = Config(keyframes=EVERY_FRAME)
    build_map(frames, tmp_path / 'net.db', config, describe=OnnxModel(net))
    return tmp_path / 'net.db'


def test_an_answer_has_the_time_of_the_model(client, vpr, net, net_map, street, image):
    vpr(map_path=net_map, descriptor_model=str(net), **PERIOD)
    answers = client.listen(DiagnosticArray, '/vpr_node/answer')
    told = client.listen(DiagnosticArray, '/diagnostics')
    client.camera(Image).publish(image(street[0], 100 * SECOND))
    client.wait_for(lambda: answers and told)
    found = client.values_of(answers[0])
    assert 0 < float(found['model_ms']) < float(found['duration_ms'])
    client.wait_for(lambda: float(client.values_of(told[-1])['model_ms']) > 0)
    assert client.values_of(told[-1])['model'].startswith('#')


@pytest.mark.parametrize('mode', ['preloaded', 'online'])
def test_a_model_that_fails_is_reported_and_the_built_in_descriptor_takes_over(
    client, vpr, net, net_map, street, image, monkeypatch, mode
):
    kept = {'keyframe_overlap': 1.0} if mode == 'online' else {}
    vpr(map_path=net_map, descriptor_model=str(net), mode=mode, **kept, **PERIOD)
    answers = client.listen(DiagnosticArray, '/vpr_node/answer')
    told = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    camera.publish(image(street[0], 100 * SECOND))
    client.wait_for(lambda: len(answers) == 1)

    def fails(*_):
        raise ModelError('net.onnx: the model fails (out of memory)')

    monkeypatch.setattr(OnnxModel, '_run', fails)
    for index in range(1, 4):
        camera.publish(image(street[index], (100 + index) * SECOND))
    client.wait_for(lambda: len(answers) == 4)  # every frame has its answer
    line = 'out of memory); the built-in descriptor is used, and the map does not grow'
    client.wait_for(lambda: line in told[-1].status[0].message)
    assert told[-1].status[0].level == DiagnosticStatus.WARN
    assert 'model_ms' not in client.values_of(answers[-1])
    assert len(open_map(net_map)) == 25 + (mode == 'online')


def test_a_model_that_is_too_slow_is_reported(
    client, vpr, net, net_map, street, image, monkeypatch
):
    describe = OnnxModel.__call__

    def takes_long(*given):
        time.sleep(0.1)
        return describe(*given)

    monkeypatch.setattr(OnnxModel, '__call__', takes_long)
    vpr(map_path=net_map, descriptor_model=str(net), queue_size=1, **PERIOD)
    told = client.listen(DiagnosticArray, '/diagnostics')
    camera, stamps = client.camera(Image), count(100)
    slow = re.compile(r'frames dropped: .* of which the model takes \d{3} ms')

    def is_told():
        camera.publish(image(street[0], next(stamps) * SECOND))
        states = [one.status[0] for one in told]
        return any(
            one.level == DiagnosticStatus.WARN and slow.search(one.message) for one in states
        )

    client.wait_for(is_told)


def test_another_model_or_none_of_its_kind_is_refused_at_the_start(vpr, net, net_map, tmp_path):
    made(net, 'random', 64, 128)  # under the same name
    with pytest.raises(MapError, match=r'descriptor_model .* asked for descriptor_model'):
        vpr(map_path=net_map, descriptor_model=str(net))
    with pytest.raises(ModelError, match='no such file'):
        vpr(map_path=net_map, descriptor_model=str(tmp_path / 'absent.onnx'))


def test_a_missing_onnxruntime_is_reported_when_the_node_starts(vpr, net, net_map, monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'onnxruntime', None)
    with pytest.raises(ModelError, match='needs onnxruntime: pip install'):
        vpr(map_path=net_map, descriptor_model=str(net))
