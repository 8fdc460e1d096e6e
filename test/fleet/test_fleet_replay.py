# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps, of two cameras as well, answers as one map would that was made of all."""

import gc
import json
import os
from pathlib import Path
import shutil
import signal
import socket

from convseq_ros.cli import main
from convseq_ros.config import Config, make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.errors import FleetError
from convseq_ros.fleet.cluster import Cluster, connected
from convseq_ros.fleet.fleet import Fleet
from convseq_ros.io.results import read_results
import pytest
from two_cameras import COUNT, record_two_cameras, TOPICS

FRAMES = 20
SETTINGS = '--keyframe-overlap', '1'
FIXED = '--fixed-length', '10'
BOTH = '--both-directions', 'true'
FLAGS = (), BOTH, (*FIXED, '--acceptance-rule', 'margin'), ('--matching', 'regional')


@pytest.mark.parametrize('more', FLAGS)
def test_a_fleet_answers_every_frame_as_one_map(drives, scheduler, tmp_path, capsys, more):
    maps, one, again = drives
    tables = [tmp_path / name for name in ('one.csv', 'fleet.csv')]
    wanted = ['replay', str(again), '--map', str(one), '--output', str(tables[0]), *more]
    assert main(wanted) == 0
    fleet = ['fleet', 'replay', str(maps), str(again), '--scheduler', scheduler, '--json']
    capsys.readouterr()
    assert main([*fleet, '--output', str(tables[1]), *more]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['missing'] == [] and told['frames'] == FRAMES + FRAMES // 2
    rows = [read_results(table) for table in tables]
    for row in (*rows[0], *rows[1]):
        del row['duration_ms'], row['anchor_session']  # of maps that were built apart
    assert rows[0] == rows[1]
    accepted = {int(row['reference_index']) for row in rows[0] if row['reference_index']}
    if more in ((), BOTH):
        assert accepted & {*range(FRAMES, 2 * FRAMES)}
        assert accepted & {*range(2 * FRAMES, 3 * FRAMES)}


def test_a_fleet_keeps_the_links_of_its_maps(drives, client, tmp_path, answers_of):
    maps, _, again = drives
    paths = [shutil.copy(path, tmp_path) for path in sorted(maps.glob('*.db'))]
    assert main(['build-map', str(again), str(paths[1]), *SETTINGS, '--append']) == 0
    one, parts = tmp_path / 'one' / 'one.db', [str(path) for path in paths]
    one.parent.mkdir()
    assert main(['map', 'merge', *parts, '-o', str(one), '--no-links']) == 0
    fleet, merged = Fleet(client, [*map(Path, paths)], Config()), open_map(one)
    linked = [*fleet.reference_map.links]
    assert linked == [*merged.links] and len(linked) > FRAMES // 2
    assert [*fleet.reference_map.places] == [*merged.places]
    expected = answers_of(PlaceRecognizer(merged, Config()), again)
    assert answers_of(fleet.cameras.first, again) == expected


def listening():
    """Return the addresses at which this process waits for others."""
    kept = gc.get_objects()
    found = [one for one in kept if type(one) is socket.socket and one.fileno() >= 0]
    listens = socket.SOL_SOCKET, socket.SO_ACCEPTCONN
    own = [
        one.getsockname()
        for one in found
        if one.family != socket.AF_UNIX and one.getsockopt(*listens)
    ]
    return [f'{host}:{port}' for host, port, *_ in own]


def test_workers_in_threads_give_the_same_answers(drives, expected, answers_of):
    pytest.importorskip('distributed', reason='needs dask.distributed, the extra `fleet`')
    maps, _, again = drives
    with connected(Cluster(workers=2, are_threads=True)) as client:
        assert client.scheduler.address.startswith('inproc://')
        assert {address.rpartition(':')[0] for address in listening()} <= {'127.0.0.1'}
        fleet = Fleet(client, sorted(maps.glob('*.db')), Config())
        assert answers_of(fleet.cameras.first, again) == expected


def test_a_worker_that_dies_in_the_middle_loses_nothing(drives, client, expected, answers_of):
    maps, _, again = drives
    fleet = Fleet(client, sorted(maps.glob('*.db')), Config())

    def kill(number):
        if number in (8, 20):
            pids = client.run(os.getpid)
            os.kill(pids[min(pids)], signal.SIGKILL)

    assert answers_of(fleet.cameras.first, again, kill) == expected
    assert fleet.missing == []


def test_maps_that_cannot_be_opened_are_left_out_and_named(
    drives, scheduler, expected, tmp_path, capsys
):
    maps, _, again = drives
    folder = tmp_path / 'some'
    shutil.copytree(maps, folder)
    (folder / 'map_0a.db').write_bytes(b'SQLite format 3\0 and nothing else')
    other = ['--image-size-px', '256']
    assert main(['build-map', str(again), str(folder / 'map_9.db'), *SETTINGS, *other]) == 0
    capsys.readouterr()
    table = tmp_path / 'table.csv'
    fleet = ['fleet', 'replay', str(folder), str(again), '--scheduler', scheduler]
    assert main([*fleet, '--output', str(table)]) == 0
    printed = capsys.readouterr()
    warnings = [line for line in printed.err.splitlines() if line.startswith('warning: ')]
    assert len(warnings) == 2 and all('the other maps answer' in line for line in warnings)
    assert 'map_0a.db' in warnings[0] + warnings[1]
    assert 'image_size_px' in warnings[0] + warnings[1]
    assert '60 places of 3 maps, 2 of 5 maps missing' in printed.out
    # The others answer as if there were no more.
    reasons = [row['reason'] for row in read_results(table)]
    assert reasons == [said[1] for said in expected]


def test_a_map_that_is_damaged_later_is_left_out_from_then_on(
    drives, client, tmp_path, answers_of
):
    maps, _, again = drives
    folder = tmp_path / 'some'
    shutil.copytree(maps, folder)
    fleet, damaged = (Fleet(client, sorted(folder.glob('*.db')), Config()), folder / 'map_1.db')
    content = bytearray(damaged.read_bytes())
    content[len(content) // 4 :] = bytes(len(content) - len(content) // 4)
    damaged.write_bytes(content)
    said = answers_of(fleet.cameras.first, again)
    assert len(fleet.missing) == 1 and str(damaged) in fleet.missing[0]
    accepted = {one[2][0].reference_index for one in said if one[1] == 'accepted'}
    assert accepted and accepted <= {*range(2 * FRAMES, 3 * FRAMES)}


def test_a_fleet_without_a_readable_map_is_refused_with_the_reason(client, tmp_path, capsys):
    assert main(['fleet', 'replay', str(tmp_path), str(tmp_path)]) == 1
    assert 'no map in it (*.db)' in capsys.readouterr().err
    (tmp_path / 'a.db').write_bytes(b'nothing')
    with pytest.raises(FleetError, match=r'no map of 1 can be opened: .*a\.db'):
        Fleet(client, [tmp_path / 'a.db'], Config())


@pytest.mark.parametrize(('name', 'value'), [('search', 'exhaustive'), ('mode', 'online')])
def test_a_setting_that_a_fleet_does_not_support_is_refused(client, drives, name, value):
    with pytest.raises(FleetError, match=f'{name} {value}: .*; leave it out'):
        Fleet(client, sorted(drives[0].glob('*.db')), make_config({name: value}))


CAMERAS = '--topic', ' '.join(TOPICS)
KEPT = '--keep-images-px', '40', '--keyframe-overlap', '1'


@pytest.fixture(scope='module')
def maps(tmp_path_factory, scheduler):
    """Return a folder of recordings, one of their maps, and one map merged from these."""
    pytest.importorskip('rosbags')
    folder, made = tmp_path_factory.mktemp('recorded'), tmp_path_factory.mktemp('made')
    for number in range(2):
        record_two_cameras(folder / f'drive_{number}', 1000 * number)
    wanted = 'fleet', 'build', str(folder), '-o', str(made), '--scheduler', scheduler
    assert main([*wanted, *CAMERAS, *KEPT]) == 0
    one = tmp_path_factory.mktemp('one') / 'one.db'
    parts = [str(path) for path in sorted(made.glob('*.db'))]
    assert main(['map', 'merge', *parts, '-o', str(one), '--no-links']) == 0
    return folder, made, one


def test_maps_are_those_of_build_map(maps, tmp_path):
    folder, made, _ = maps
    own = tmp_path / 'own.db'
    assert main(['build-map', str(folder / 'drive_1'), str(own), *CAMERAS, *KEPT]) == 0
    own, built = open_map(own), open_map(made / 'drive_1.db')
    assert [one.name for one in own.sessions] == [one.name for one in built.sessions]
    assert [*own.places] == [*built.places] and len(own) == 2 * COUNT
    pictures = [one.pictures(range(len(own)), True) for one in (own, built)]
    kept = [[(one.packed.tobytes(), one.image) for one in each] for each in pictures]
    assert kept[0] == kept[1] and all(image for _, image in kept[0])


def test_workers_send_images(maps, client):
    _, made, one = maps
    fleet, merged = Fleet(client, sorted(made.glob('*.db')), Config()), open_map(one)
    asked = [0, COUNT, 3 * COUNT - 1, 2 * COUNT]
    whole = fleet.cameras.first.reference_map.pictures(asked, True)
    assert [each.image for each in whole] == [each.image for each in merged.pictures(asked, True)]
    assert all(each.image for each in whole)
    assert not fleet.cameras.first.reference_map.pictures(asked)[0].image
