# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A signal while a process starts or works, and what Fast DDS is told."""

import os
from pathlib import Path
import signal
import sys

from convseq_ros.node import process
from convseq_ros.node.process import fast_dds, LARGE_IMAGES, QUICK_START, VARIABLE
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


def interrupted(number, when, module, *arguments):
    words = '-c', INTERRUPTED, str(int(number)), when, module, *arguments
    ours = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)}
    return run(sys.executable, *words, env=ours, timeout=180)


@pytest.mark.parametrize(('number', 'when'), [(signal.SIGINT, 'numpy'), (signal.SIGTERM, 'rclpy')])
def test_a_signal_during_imports_ends_a_node_silently(number, when):
    pytest.importorskip('rclpy')
    done = interrupted(number, when, 'convseq_ros.node')
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('when', ['numpy', 'rosbags'])
def test_a_signal_ends_a_command_with_one_line(number, when, tmp_path):
    # NumPy is imported at the start; what reads recordings when the work has begun.
    (tmp_path / 'drive.mcap').write_text('hello')
    arguments = 'build-map', str(tmp_path / 'drive.mcap'), str(tmp_path / 'map.db')
    done = interrupted(number, when, 'convseq_ros.cli', *arguments)
    assert (done.returncode, done.stderr) == (1, 'convseq build-map: interrupted\n')


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
@pytest.mark.parametrize(('told', 'threads'), [({}, 1), ({'OPENCV_FOR_THREADS_NUM': '2'}, 2)])
def test_programs_have_one_thread_of_opencv_unless_they_are_told(program, told, threads):
    code = f'import {program}, cv2; print(cv2.getNumThreads())'
    environment = dict(os.environ)
    environment.pop('OPENCV_FOR_THREADS_NUM', None)
    assert run(sys.executable, '-c', code, env=environment | told).stdout == f'{threads}\n'
