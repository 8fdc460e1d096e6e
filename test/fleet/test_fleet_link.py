# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's link to a fleet that may go away, and the links of a fleet's maps."""

from dataclasses import replace
import json
import os
import shutil
import signal
import time

from convseq_ros.cli import main
from convseq_ros.config import Config
from convseq_ros.fleet import link as module
from convseq_ros.fleet.cluster import Cluster
from convseq_ros.fleet.link import FleetLink, serve
from convseq_ros.sources import open_source
from programs import wait_for
import pytest

CAMERAS = '/front', '/rear'


@pytest.fixture
def linked(client, scheduler, drives, monkeypatch):
    """Return a link of two cameras to a fleet of three maps, and what it told."""
    monkeypatch.setattr(module, '_AGAIN_S', 0.1)
    serve(client, sorted(drives[0].glob('*.db')))
    told = []
    link = FleetLink(
        Cluster(scheduler), Config(), lambda match, *_: told.append(match), 5.0, CAMERAS
    )
    wait_for(lambda: not link.problem)
    yield link, told
    link.close()
    client.unpublish_dataset('convseq_ros')


def test_it_answers_each_camera_as_a_replay_does(linked, drives, expected):
    link, told = linked
    for frame in open_source(drives[2]):
        for camera in CAMERAS:
            before = len(told)
            link.put(replace(frame, source=camera))
            wait_for(lambda count=before: len(told) > count)
    for camera in CAMERAS:
        own = [match for match in told if match.camera == camera]
        assert [(match.status, match.reason, match.candidates) for match in own] == [
            said[:3] for said in expected
        ]
    assert (link.answered, link.skipped) == (2 * len(expected), 0)


def test_nobody_waits_for_a_fleet_that_is_gone_and_it_comes_back(linked, client, drives):
    link, told = linked
    frames = [*open_source(drives[2])]
    link._timeout_s = 0.3
    pids = [*client.run(os.getpid).values()]
    for frame in frames[:3]:
        link.put(frame)
    wait_for(lambda: len(told) == 3)
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        started = time.monotonic()
        for frame in frames[3:20]:
            link.put(frame)
        assert time.monotonic() - started < 1
        wait_for(lambda: 'did not answer within' in link.problem)
        assert link.skipped > 0 and len(told) < 20
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)
    wait_for(lambda: not link.problem)
    before = len(told)
    link.put(frames[20])
    wait_for(lambda: len(told) > before)


def test_a_fleet_that_was_never_there_costs_nothing(drives):
    link = FleetLink(Cluster('tcp://127.0.0.1:1'), Config(), lambda *_: None, 1.0)
    for frame in open_source(drives[2]):
        link.put(frame)
    assert link.problem and link.answered == 0 and link.skipped == 30
    started = time.monotonic()
    link.close(0.2)
    assert time.monotonic() - started < 5


@pytest.fixture
def said(capsys):
    """Return a way to run a command and get what it prints as JSON, and its warnings."""

    def run(*command):
        assert main([str(one) for one in command]) == 0
        printed = capsys.readouterr()
        return json.loads(printed.out), printed.err

    return run


def test_a_fleet_is_linked_as_its_merged_map(drives, scheduler, said, tmp_path):
    maps, _, again = drives
    folder, one = tmp_path / 'maps', tmp_path / 'one.db'
    folder.mkdir()
    for path in maps.glob('*.db'):
        shutil.copy(path, folder)
    said('build-map', again, folder / 'map_3.db', '--keyframe-overlap', '1', '--json')
    said('map', 'merge', *sorted(folder.glob('*.db')), '-o', one, '--no-links', '--json')
    (folder / 'map_9.db').write_bytes(b'no map')
    graphs = [tmp_path / name for name in ('one.g2o', 'fleet.g2o')]
    expected, _ = said('map', 'link', one, '--json', '--g2o', graphs[0])
    found, warned = said(
        'fleet', 'link', folder, '--json', '--g2o', graphs[1], '--scheduler', scheduler
    )
    assert found == expected
    assert {(link['session'], link['other_session']) for link in found} >= {(3, 1), (3, 2)}
    assert graphs[0].read_text() == graphs[1].read_text()
    assert 'map_9.db' in warned and 'the other maps are linked' in warned
