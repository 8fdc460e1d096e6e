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

NODES = ['convseq_ros.node', 'convseq_ros.node.vpr_node', 'convseq_ros.node.player']


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


# A signal that comes when a lock of the running step has just been taken.
AT_A_LOCK = """
import os, signal, sys, threading

class Late(threading.Condition):
    def __enter__(self):
        taken, frame = super().__enter__(), sys._getframe()
        while frame and not is_sent:
            if frame.f_code.co_name == 'save' and 'autosave' in frame.f_code.co_filename:
                is_sent.append(os.kill(os.getpid(), signal.SIGINT))
            frame = frame.f_back
        return taken

is_sent = []
threading.Condition = Late
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
