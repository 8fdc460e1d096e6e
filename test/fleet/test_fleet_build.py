# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq fleet`: a map of each recording, whole or not at all."""

import json
import os
from pathlib import Path
import shutil
import signal
import sys

from convseq_ros.cli import fleet, main
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import replaced
from convseq_ros.errors import FleetError
from convseq_ros.fleet.cluster import finished_jobs
import pytest

SETTINGS = '--keyframe-overlap', '1'


@pytest.fixture
def build(capsys):
    """Return a way to run the command and get its exit code, its result and what it says."""
    pytest.importorskip('distributed', reason='needs dask.distributed, the extra `fleet`')

    def run(folder, maps, *args):
        how = '--workers', '2', '--json', *SETTINGS, *args
        code = main(['fleet', str(folder), '-o', str(maps), *how])
        printed = capsys.readouterr()
        return code, json.loads(printed.out) if printed.out else None, printed.err

    return run


def test_maps_that_are_finished_are_kept_and_missing_ones_made(recordings, tmp_path, build):
    maps = tmp_path / 'maps'
    code, told, _ = build(recordings, maps)
    assert code == 0 and len(told['built']) == 3
    names = ['drive_0.db', 'drive_1.db', 'drive_2.db']
    assert sorted(path.name for path in maps.iterdir()) == names
    (maps / 'drive_2.db').unlink()
    before = (maps / 'drive_0.db').stat().st_mtime_ns
    code, told, _ = build(recordings, maps)
    assert code == 0
    assert [Path(one['map']).name for one in told['built']] == ['drive_2.db']
    assert len(told['kept']) == 2
    assert (maps / 'drive_0.db').stat().st_mtime_ns == before
    # Other settings do not agree, and nobody's map is lost.
    code, told, said = build(recordings, maps, '--image-size-px', '256')
    assert code == 1 and len(told['failed']) == 3
    assert 'made with image_size_px 512, asked for 256' in said
    assert (maps / 'drive_0.db').stat().st_mtime_ns == before


def test_a_bad_recording_fails_without_the_others(recordings, tmp_path, build):
    folder, maps = tmp_path / 'some', tmp_path / 'maps'
    shutil.copytree(recordings / 'drive_0', folder / 'good')
    (folder / 'bad').mkdir()
    (folder / 'bad' / '0.png').write_bytes(b'no picture')
    code, told, said = build(folder, maps)
    assert code == 1
    assert [Path(one['map']).name for one in told['built']] == ['good.db']
    assert 'bad.db' in said and 'not a readable picture' in said
    assert len(said.splitlines()) == 1
    assert [path.name for path in maps.iterdir()] == ['good.db']


@pytest.mark.parametrize(
    ('names', 'problem'),
    [
        (['a.mcap', 'a.bag'], 'its map would have the name of that of a.bag; rename one'),
        (['a.txt'], 'no recordings in it'),
        (['a.png'], 'is a recording itself'),
    ],
)
def test_a_folder_without_distinct_recordings_is_refused(tmp_path, capsys, names, problem):
    for name in names:
        (tmp_path / name).touch()
    assert main(['fleet', str(tmp_path), '-o', str(tmp_path / 'maps')]) == 1
    assert problem in capsys.readouterr().err
    assert not (tmp_path / 'maps').exists()


def test_a_worker_that_dies_loses_nothing(client, recordings, tmp_path):
    died = tmp_path / 'died'
    jobs = {
        name: (recordings / name, tmp_path / f'{name}.db', Config())
        for name in ('drive_0', 'drive_1')
    }

    def work(recording, path, *others):
        if recording.name == 'drive_1' and not died.exists():
            died.touch()
            with replaced(path) as part:
                part.touch()
                part.with_name(f'{part.name}-lock').touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return fleet.build_one(recording, path, *others)

    found = dict(finished_jobs(client, work, jobs))
    assert died.exists()
    assert {name: built.references for name, (built, _) in found.items()} == {
        name: len(open_map(path)) for name, (_, path, *_) in jobs.items()
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == ['died', 'drive_0.db', 'drive_1.db']


def test_a_job_that_kills_its_worker_is_given_up(client):
    def allow(failures, dask_scheduler=None):
        before, dask_scheduler.allowed_failures = dask_scheduler.allowed_failures, failures
        return before

    def work():
        os.kill(os.getpid(), signal.SIGKILL)

    before = client.run_on_scheduler(allow, 0)
    try:
        ((name, error),) = finished_jobs(client, work, {'it': ()})
    finally:
        client.run_on_scheduler(allow, before)
    assert name == 'it' and isinstance(error, FleetError)
    assert 'its worker died 1 times' in str(error)


def test_a_missing_package_is_named_with_the_remedy(recordings, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main(['fleet', str(recordings), '-o', str(tmp_path / 'maps')]) == 1
    assert 'a fleet needs distributed: pip install' in capsys.readouterr().err


def test_workers_listen_on_this_machine_only(client):
    addresses = [client.scheduler.address, *client.scheduler_info()['workers']]
    assert len(addresses) == 3
    assert all(one.startswith('tcp://127.0.0.1:') for one in addresses)
    assert (
        client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.http_server.address)
        == '127.0.0.1'
    )
