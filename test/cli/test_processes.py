# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes of a demo run with."""

from pathlib import Path

from convseq_ros.cli import processes
import pytest

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
PROFILE = 'fastdds_large_images.xml'


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)


def test_large_images_are_carried_unless_the_user_has_chosen(monkeypatch, tmp_path):
    path = Path(processes.environment(tmp_path)[VARIABLE])
    assert path.name == PROFILE and path.is_file()
    monkeypatch.setenv(VARIABLE, 'mine.xml')
    assert processes.environment(tmp_path)[VARIABLE] == 'mine.xml'


@pytest.mark.parametrize(
    ('module', 'profile'),
    [
        ('lib/python3/site-packages/convseq_ros/cli/processes.py', 'share/convseq_ros/config'),
        ('convseq_ros/cli/processes.py', 'config'),
    ],
)
def test_the_settings_are_found_where_they_are_installed(monkeypatch, tmp_path, module, profile):
    monkeypatch.setattr(processes, '__file__', str(tmp_path / module))
    assert processes.for_large_images() == {}
    folder = tmp_path / profile
    folder.mkdir(parents=True)
    (folder / PROFILE).touch()
    assert processes.for_large_images() == {VARIABLE: str(folder / PROFILE)}
