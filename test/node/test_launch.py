# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The launch file, read by the real `launch`, where that is installed."""

from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip('launch_ros', reason='launch and launch_ros come with ROS, not from PyPI')

import launch
from launch import LaunchDescription, LaunchService
from launch.actions import EmitEvent, IncludeLaunchDescription, RegisterEventHandler
from launch.event_handlers import OnProcessStart
from launch.events import Shutdown
from launch.launch_description_sources import AnyLaunchDescriptionSource
import yaml

OURS = Path(__file__).resolve().parents[2] / 'launch' / 'vpr.launch.py'
OWN = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

def generate_launch_description():
    ours = IncludeLaunchDescription(
        PythonLaunchDescriptionSource({ours!r}), launch_arguments={words!r}.items()
    )
    return LaunchDescription([DeclareLaunchArgument('speed', default_value='1'), ours])
"""
XML = '<launch><arg name="speed" default="1"/><include file="{ours}">{words}</include></launch>'


def launched(path, **words):
    """Return the words of the command line and the parameters of the process that is started."""
    command, values = [], {}

    def look(event, _context):
        command.extend(event.cmd)
        for option, file in pairwise(event.cmd):
            if option == '--params-file':
                (content,) = yaml.safe_load(Path(file).read_text()).values()
                values.update(content['ros__parameters'])
        return EmitEvent(event=Shutdown())

    source = AnyLaunchDescriptionSource(str(path))
    actions = [
        RegisterEventHandler(OnProcessStart(on_start=look)),
        IncludeLaunchDescription(source, launch_arguments=words.items()),
    ]
    service = LaunchService(argv=[], noninteractive=True)
    service.include_launch_description(LaunchDescription(actions))
    service.run()
    return command, values


def test_arguments_reach_the_node_in_the_type_of_the_parameter():
    words = {'queue_size': '7', 'map_path': '5', 'lifecycle': 'true', 'min_margin': '1'}
    command, values = launched(OURS, **words, image='/front/image', log_level='debug')
    assert values['queue_size'] == 7 and values['map_path'] == '5' and values['lifecycle'] is True
    assert values['min_margin'] == 1.0 and values['use_sim_time'] is False
    assert values['max_wait_s'] == 1.0  # of the file of parameters
    assert {('--log-level', 'debug'), ('-r', 'image:=/front/image')} <= {*pairwise(command)}


@pytest.mark.parametrize('kind', ['vpr.launch.py', 'own.launch.xml'])
def test_a_launch_file_that_includes_ours_has_its_own_arguments(
    tmp_path, kind, caplog, monkeypatch
):
    monkeypatch.setattr(launch.logging.get_logger('launch'), 'propagate', True)
    own = tmp_path / kind

    def write(**words):
        arguments = ''.join(f'<arg name="{name}" value="{words[name]}"/>' for name in words)
        xml = XML.format(ours=OURS, words=arguments)
        own.write_text(xml if 'xml' in kind else OWN.format(ours=str(OURS), words=words))

    write(queue_size='9')
    assert launched(own, speed='3')[1]['queue_size'] == 9
    write(queue_siz='9')
    assert launched(own, speed='3') == ([], {})
    assert "no such argument 'queue_siz'; did you mean queue_size?" in caplog.text
