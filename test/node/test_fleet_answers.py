# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameter `fleet`: other maps are asked beside the node's own."""

import math

from convseq_ros.errors import FleetError
from convseq_ros.fleet.cluster import Cluster, connected
from convseq_ros.fleet.link import serve
from convseq_ros.node import diagnostics, publishers
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.srv import LoadMap
import pytest
from sensor_msgs.msg import Image

SECOND = 1_000_000_000
OWN = 'duration_ms', 'map_id', 'session_id'


def test_a_fleet_of_the_same_map_says_the_same(client, vpr, street, image, map_path, monkeypatch):
    pytest.importorskip('distributed', reason='needs dask.distributed, the extra `fleet`')
    monkeypatch.setattr(publishers, 'TIMEOUT_S', 20.0)
    with connected(Cluster(workers=1)) as dask:
        serve(dask, [map_path])
        more = {'matching': 'coherent', 'search': 'shortlist', 'fleet': dask.scheduler.address}
        node = vpr(map_path=map_path, **more)
        own = client.listen(DiagnosticArray, '/vpr_node/answer')
        others = client.listen(DiagnosticArray, '/vpr_node/fleet_answer')
        camera = client.camera(Image)
        client.wait_for(lambda: not node._fleet.problem)
        for index in range(6):
            camera.publish(image(street[index], index * SECOND + 7))
            client.wait_for(lambda count=index: min(len(own), len(others)) > count)
        node.context.try_shutdown()
    for here, there in zip(own, others, strict=True):
        assert here.header == there.header
        here, there = client.values_of(here), client.values_of(there)
        for name in OWN:
            here.pop(name, None), there.pop(name, None)
        assert here == there
    assert client.values_of(others[-1])['reference_index'] == '5'


def test_the_own_map_answers_alone_when_the_fleet_is_gone(
    client, vpr, street, image, map_path, monkeypatch
):
    # A camera that stopped is told first.
    monkeypatch.setattr(diagnostics, '_SILENCE_S', math.inf)
    vpr(map_path=map_path, fleet='tcp://127.0.0.1:1', diagnostics_period_s=0.1)
    own = client.listen(DiagnosticArray, '/vpr_node/answer')
    states = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    for index in range(4):
        camera.publish(image(street[index], index * SECOND + 7))
    client.wait_for(lambda: len(own) == 4)
    assert client.values_of(own[-1])['reference_index'] == '3'
    said = "the fleet does not answer, only the node's map does"
    client.wait_for(lambda: states and said in states[-1].status[0].message)
    assert states[-1].status[0].level == DiagnosticStatus.WARN
    assert client.values_of(states[-1])['fleet_answered'] == '0'
    # Whoever is on the network cannot have the node talk to an address.
    loaded = client.call(LoadMap, '/vpr_node/load_map', map_url='tcp://127.0.0.1:8786')
    assert loaded.result == LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST


def test_another_machine_without_tls_is_refused_at_the_start(vpr, map_path):
    with pytest.raises(FleetError, match=r'10\.0\.0\.1:8786: is not this machine'):
        vpr(map_path=map_path, fleet='tcp://10.0.0.1:8786')
