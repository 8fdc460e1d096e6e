# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Fast DDS is told, unless the user has chosen."""

from pathlib import Path

from convseq_ros import process
from convseq_ros.cli.processes import environment
from convseq_ros.process import fast_dds, LARGE_IMAGES, QUICK_START, VARIABLE
import pytest


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)


@pytest.mark.parametrize('profile', [LARGE_IMAGES, QUICK_START])
@pytest.mark.parametrize('chosen', [VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'])
def test_ours_count_unless_the_user_has_chosen(monkeypatch, profile, chosen):
    path = Path(fast_dds(profile)[VARIABLE])
    assert path.name == profile and path.is_file()
    monkeypatch.setenv(chosen, 'mine.xml')
    assert fast_dds(profile) == {}


def test_the_processes_of_a_demo_carry_large_images(tmp_path):
    assert Path(environment(tmp_path)[VARIABLE]).name == LARGE_IMAGES


@pytest.mark.parametrize(
    ('module', 'profile'),
    [
        ('lib/python3/site-packages/convseq_ros/process.py', 'share/convseq_ros/config'),
        ('convseq_ros/process.py', 'config'),
    ],
)
def test_they_are_found_where_they_are_installed(monkeypatch, tmp_path, module, profile):
    monkeypatch.setattr(process, '__file__', str(tmp_path / module))
    assert fast_dds(QUICK_START) == {}
    folder = tmp_path / profile
    folder.mkdir(parents=True)
    (folder / QUICK_START).touch()
    assert fast_dds(QUICK_START) == {VARIABLE: str(folder / QUICK_START)}
