# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A signal while a process still imports what it needs, and what Fast DDS is told."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from convseq_ros.core.map.reader import open_map
from convseq_ros.node import process
from convseq_ros.node.process import fast_dds, LARGE_IMAGES, QUICK_START, VARIABLE
from pictures import scene, written
from programs import run
import pytest

# Sends a signal to itself as soon as something is about to be imported, then runs what is named.
INTERRUPTED = """
import os, runpy, sys

_, number, when, module, *arguments = sys.argv

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == when and self in sys.meta_path:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), int(number))

sys.meta_path.insert(0, Interrupting())
sys.argv[1:] = arguments
runpy.run_module(module, run_name='__main__', alter_sys=True)
"""

NODES = ['convseq_ros.node', 'convseq_ros.node.vpr_node']


def interrupted(number, when, module, *arguments):
    return run(
        sys.executable,
        '-c',
        INTERRUPTED,
        str(int(number)),
        when,
        module,
        *arguments,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        timeout=180,
    )


@pytest.mark.parametrize(('number', 'when'), [(signal.SIGINT, 'numpy'), (signal.SIGTERM, 'rclpy')])
@pytest.mark.parametrize('module', NODES)
def test_a_signal_during_imports_ends_a_node_silently(number, when, module):
    pytest.importorskip('rclpy')
    done = interrupted(number, when, module)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('when', ['numpy', 'cv2'])
def test_a_signal_during_imports_ends_a_command_with_one_line(number, when):
    done = interrupted(number, when, 'convseq_ros.cli', 'build-map', 'none', 'none.db')
    assert (done.returncode, done.stderr) == (1, 'convseq: interrupted\n')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_work_ends_a_command_with_one_line(number, tmp_path):
    # What reads recordings is imported when the work has begun.
    (tmp_path / 'drive.mcap').write_text('hello')
    arguments = 'build-map', str(tmp_path / 'drive.mcap'), str(tmp_path / 'map.db')
    done = interrupted(number, 'rosbags', 'convseq_ros.cli', *arguments)
    assert (done.returncode, done.stderr) == (1, 'convseq build-map: interrupted\n')


# A signal that comes when a frame has just taken a lock, for which the end of the work waits.
AT_A_LOCK = """
import os, signal, sys, threading
from convseq_ros.core.map.autosave import Autosave

class Late(threading.Condition):
    def __enter__(self):
        taken = super().__enter__()
        os.kill(os.getpid(), signal.SIGINT)
        return taken

lock, save, close = Late(threading.Lock()), Autosave.save, Autosave.close

def locking_save(self):
    with lock:
        save(self)

def locking_close(self):
    if not lock.acquire(timeout=1):
        os._exit(3)
    close(self)

Autosave.save, Autosave.close = locking_save, locking_close
from convseq_ros.node.process import run
sys.exit(run('convseq_ros.cli', 1))
"""


@pytest.mark.parametrize('verb', ['build-map', 'replay'])
def test_a_signal_while_a_lock_is_held_ends_a_command_after_the_frame(verb, tmp_path):
    folder, path = written(tmp_path / 'drive', map(scene, range(5))), tmp_path / 'map.db'
    words = ['--map', path, '--mode', 'online', '--output', tmp_path / 'result.csv']
    words = [path] if verb == 'build-map' else words
    done = run(sys.executable, '-c', AT_A_LOCK, verb, str(folder), *map(str, words), timeout=180)
    assert done.returncode == 1 and f'convseq {verb}: interrupted' in done.stderr
    assert len(open_map(path)) == 1 and len([*tmp_path.glob('map.db*')]) == 1


# A signal that comes when a map has just been opened, or is about to be closed.
AT_A_MAP = """
import os, signal, sys
from convseq_ros.core.map.autosave import Autosave

when, method = sys.argv.pop(1), sys.argv.pop(1)
original = getattr(Autosave, method)

def interrupted(self, *given, **more):
    if when == 'before':
        os.kill(os.getpid(), signal.SIGINT)
    result = original(self, *given, **more)
    if when == 'after':
        os.kill(os.getpid(), signal.SIGINT)
    return result

setattr(Autosave, method, interrupted)
from convseq_ros.node.process import run
sys.exit(run('convseq_ros.cli', 1))
"""


@pytest.mark.parametrize('verb', ['build-map', 'replay'])
@pytest.mark.parametrize(('when', 'places'), [('after __init__', 0), ('before close', 5)])
def test_a_signal_while_a_map_is_opened_or_closed_leaves_nothing_beside_it(
    verb, when, places, tmp_path
):
    folder, path = written(tmp_path / 'drive', map(scene, range(5))), tmp_path / 'map.db'
    words = ['--map', path, '--mode', 'online', '--output', tmp_path / 'result.csv']
    words = [folder, *([path] if verb == 'build-map' else words)]
    start = sys.executable, '-c', AT_A_MAP, *when.split(), verb
    done = run(*start, *map(str, words), timeout=180)
    assert done.returncode == 1 and f'convseq {verb}: interrupted' in done.stderr
    left = ['map.db'] if places or verb == 'replay' else []
    assert [file.name for file in tmp_path.glob('map.db*')] == left
    if places:
        assert len(open_map(path)) == places


@pytest.mark.parametrize(('reads', 'works'), [(0, None), (1, None), (3, None), (None, 2)])
def test_an_interruption_waits_for_the_end_of_a_step(reads, works, monkeypatch):
    monkeypatch.setattr(process, '_later', None)
    monkeypatch.setattr(sys, 'unraisablehook', sys.unraisablehook)
    read, worked = [], []

    def items():
        for number in range(4):
            if number == reads:
                process.interrupt()
            read.append(number)
            if number < 3:
                yield number

    with pytest.raises(KeyboardInterrupt):
        for number in process.steps(items()):
            if number == works:
                process.interrupt()
            worked.append(number)
    last = 3 if reads is None else reads
    assert read == [*range(last + 1)] and worked == [*range(last)] and not process._is_held


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)


@pytest.mark.parametrize('profile', [LARGE_IMAGES, QUICK_START])
@pytest.mark.parametrize('chosen', [VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'])
def test_our_fast_dds_profile_is_used_unless_the_user_chose_one(monkeypatch, profile, chosen):
    path = Path(fast_dds(profile)[VARIABLE])
    assert path.name == profile and path.is_file()
    monkeypatch.setenv(chosen, 'mine.xml')
    assert fast_dds(profile) == {}


@pytest.mark.parametrize(
    ('module', 'profile'),
    [
        ('lib/python3/site-packages/convseq_ros/node/process.py', 'share/convseq_ros/config'),
        ('convseq_ros/node/process.py', 'config'),
    ],
)
def test_the_fast_dds_profiles_are_found_where_they_are_installed(
    monkeypatch, tmp_path, module, profile
):
    monkeypatch.setattr(process, '__file__', str(tmp_path / module))
    assert fast_dds(QUICK_START) == {}
    folder = tmp_path / profile
    folder.mkdir(parents=True)
    (folder / QUICK_START).touch()
    assert fast_dds(QUICK_START) == {VARIABLE: str(folder / QUICK_START)}


@pytest.mark.parametrize('program', ['convseq_ros.cli', 'convseq_ros.node'])
def test_programs_have_one_thread_of_opencv_unless_they_are_reported(program):
    code = f'import {program}, cv2; print(cv2.getNumThreads())'
    for told, threads in ((None, 1), ('2', 2)):
        environment = {**os.environ, 'OPENCV_FOR_THREADS_NUM': told or ''}
        if told is None:
            del environment['OPENCV_FOR_THREADS_NUM']
        said = subprocess.run(
            [sys.executable, '-c', code], env=environment, capture_output=True, check=True
        )
        assert int(said.stdout) == threads
