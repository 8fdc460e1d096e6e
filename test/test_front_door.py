# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What README, launch file and hints promise a stranger is true where it can be run here."""

from pathlib import Path
import re
import sys
import sysconfig

from convseq_ros import errors
from convseq_ros.config import core_parameters
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.core.decision import likelihood
from convseq_ros.core.types import Reason
from convseq_ros.errors import ConfigError
from programs import run
import pytest
from recorded_launch import generator_of, record_launch

REPOSITORY = Path(__file__).resolve().parents[1]
README = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
PARAMETERS = [*core_parameters(), *parameters(NodeConfig)]
LINK = re.compile(r'\]\(([^)#\s]+)(?:#[^)\s]*)?\)')


def table(text, title):
    """Return the rows of the table that begins with a title, by place and column."""
    titles, _, *rows = text[text.index(f'|{title}|') :].split('\n\n')[0].splitlines()
    columns, *cells = (
        [cell.strip(' *') for cell in row.split('|')[1:-1]] for row in (titles, *rows)
    )
    return {place: dict(zip(columns[1:], rest, strict=True)) for place, *rest in cells}


def test_the_readme_and_the_results_page_have_the_same_recall():
    results = (REPOSITORY / 'docs' / 'RESULTS.md').read_text(encoding='utf-8').replace('| ', '|')
    results = results.replace(' |', '|')
    best = table(results, 'best / slips are false, %')
    own, told = table(results, 'own, % (false)'), table(README, 'place')
    assert [*told] == [*best] and len(told) == 10
    for place, cells in told.items():
        share, *false = own[place]['ours'].split()
        rule, _known, *shares = best[place].values()
        rounded = [f'{float(cell.split()[0]):.0f}' if cell else '' for cell in shares]
        expected = [rule, ' '.join([f'{float(share):.0f}', *false]), *rounded]
        assert [*cells.values()] == expected, place


def test_the_equation_of_the_likelihood_is_the_same_on_its_page_and_in_its_code():
    page = (REPOSITORY / 'docs' / 'MATCHING.md').read_text(encoding='utf-8')
    of_page, of_code = (
        re.findall(r'^    [RCK] = .*$', text, re.MULTILINE) for text in (page, likelihood.__doc__)
    )
    assert of_page == of_code and len(of_page) == 3


def test_an_idea_that_did_not_pay_has_at_most_25_words():
    notes = (REPOSITORY / 'docs' / 'NOTES.md').read_text(encoding='utf-8')
    ideas = re.findall(r'^- (.*(?:\n  .*)*)', notes, re.MULTILINE)
    assert len(ideas) > 30
    assert [idea for idea in ideas if len(idea.split()) > 25] == []


def pages():
    found = run(
        'git', 'ls-files', '--cached', '--others', '--exclude-standard', '*.md', cwd=REPOSITORY
    )
    return [REPOSITORY / name for name in found.stdout.split()]


def test_links_inside_the_repository_lead_somewhere():
    broken = [
        f'{page.relative_to(REPOSITORY)}: {target}'
        for page in pages() or [REPOSITORY / 'README.md', *(REPOSITORY / 'docs').rglob('*.md')]
        for target in LINK.findall(page.read_text(encoding='utf-8'))
        if ':' not in target and not (page.parent / target).exists()
    ]
    assert not broken


def test_the_page_of_topics_has_every_topic_service_and_reason():
    page = (REPOSITORY / 'docs' / 'TOPICS.md').read_text(encoding='utf-8')
    files = [*(REPOSITORY / 'convseq_ros' / 'node').rglob('*.py')]
    own = {name for file in files for name in re.findall(r"'(~/\w+)'", file.read_text('utf-8'))}
    settings = {item.name for item in parameters(NodeConfig) if 'topic' in item.name}
    named = own | settings | {'image', 'odom', 'camera_info', 'initialpose', '/diagnostics'}
    assert len(own) > 15 and settings == {'image_topics'}
    assert not [name for name in named | {*Reason} if not re.search(f'[`/]{name}`', page)]


def test_the_python_of_the_readme_runs():
    (code,) = re.findall(r'```python\n(.*?)```', README, re.DOTALL)
    drawn = 'import numpy as np, os, tempfile; os.chdir(tempfile.mkdtemp())\n' + (
        'images = np.random.default_rng(0).integers(0, 200, (30, 96, 128), np.uint8)\n'
        'first_drive = second_drive = [(1 + n * 10**9, gray) for n, gray in enumerate(images)]\n'
    )
    result = run(sys.executable, '-c', drawn + code)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == 'accepted 29'


class IncludeLaunchDescription:
    """What `ros2 launch` and launch files include ours with."""

    def __init__(self, words):
        self.launch_arguments = [word.split(':=') for word in words if ':=' in word]

    def execute(self, generate):
        return generate()


@pytest.fixture
def launched(monkeypatch):
    """Return what makes the node of the launch file from the words of a command line."""
    record_launch(monkeypatch, str(REPOSITORY))

    def make(command, **others):
        """`others` are arguments of a launch file that includes ours."""
        generate = generator_of(REPOSITORY / 'launch' / 'vpr.launch.py')
        including = IncludeLaunchDescription(command.split())
        *arguments, start = including.execute(generate).args[0]
        context = {one.args[0]: one.kwargs['default_value'] for one in arguments}
        context |= dict(including.launch_arguments)
        *beside, node = start.kwargs['function'](context | others, *start.kwargs['args'])
        assert {item.name for item in PARAMETERS} < context.keys()
        return node.kwargs | {'beside': [one.kwargs for one in beside]}

    return make


def test_the_launch_lines_of_the_readme_set_topics_map_and_mode(launched):
    preloaded, online = (one for one in README.splitlines() if one.startswith('ros2 launch'))
    node = launched(preloaded)
    file, chosen = node['parameters']
    assert file == str(REPOSITORY / 'config' / 'vpr_node.yaml')
    assert chosen == {'map_path': 'map.db', 'use_sim_time': False}
    assert ('image', '/camera/image_raw') in node['remappings']
    assert ('odom', '/odom') in node['remappings']
    node = launched(online)
    assert node['namespace'] == 'robot1' and node['remappings'] == []
    assert node['parameters'][1] == {'mode': 'online', 'map_path': 'home.db', 'use_sim_time': True}


def test_every_parameter_is_a_launch_argument_of_its_type(launched):
    node = launched('queue_size:=7 publish_initial_pose:=true map_path:=5 min_margin:=1')
    assert node['parameters'][1] == {
        'queue_size': 7, 'publish_initial_pose': True, 'map_path': '5', 'min_margin': 1.0,
        'use_sim_time': False,
    }  # fmt: skip


def test_launch_arguments_set_respawn_log_level_and_rviz(launched):
    node = launched('map_path:=map.db')
    assert not node['respawn'] and not node['beside']
    node = launched('respawn:=true rviz:=true log_level:=debug')
    assert node['respawn'] and node['ros_arguments'] == ['--log-level', 'debug']
    assert node['beside'][0]['package'] == 'rviz2'
    assert node['beside'][0]['arguments'] == ['-d', str(REPOSITORY / 'config' / 'convseq.rviz')]


def test_a_camera_sets_its_topics_and_other_arguments_override_them(launched):
    assert dict(launched('camera:=zed odom:=/wheels')['remappings']) == {
        'image': 'zed/zed_node/rgb/color/rect/image',
        'camera_info': 'zed/zed_node/rgb/color/rect/camera_info',
        'odom': '/wheels',
    }


@pytest.mark.parametrize(
    ('word', 'told'),
    [
        ('map_pth:=map.db', "no such argument 'map_pth'; did you mean map_path"),
        ('camera:=relsense', r"no such camera 'relsense'; did you mean realsense\?"),
        ('method:=papr', r"no such method 'papr'; did you mean paper\?"),
        ('queue_size:=0', r'queue_size: 0 is outside 1 \.\. 10000'),
    ],
)
def test_a_launch_argument_without_a_meaning_is_refused(launched, word, told):
    with pytest.raises(ConfigError, match=told):
        launched(word)


def test_the_papers_method_is_one_argument(launched):
    def files(method):
        return [Path(one).name for one in launched(f'method:={method}')['parameters'][1:-1]]

    assert (files('paper'), files('')) == (['paper.yaml'], [])


def test_arguments_of_a_launch_file_that_includes_ours_are_its_own(launched):
    node = launched('map_path:=map.db', speed='3')
    assert node['parameters'][1]['map_path'] == 'map.db'


# Hints.


def test_install_hints_suit_an_environment_that_apt_manages(monkeypatch, tmp_path):
    assert errors.pip_install('mcap', 'a[b]') == "pip install mcap 'a[b]'"
    (tmp_path / 'EXTERNALLY-MANAGED').touch()
    monkeypatch.setattr(sysconfig, 'get_path', lambda _: str(tmp_path))
    monkeypatch.setattr(sys, 'prefix', sys.base_prefix)
    hint = 'pip install --break-system-packages mcap (in a venv, without that option)'
    assert errors.pip_install('mcap') == hint
    monkeypatch.setattr(errors, 'find_spec', lambda _: None)
    assert errors.pip_install('mcap') == f'sudo apt install python3-pip && {hint}'


# The node without ROS.


def node(*args):
    code = (
        'import sys; sys.modules["rclpy"] = None; import importlib.util as u; '
        'find = u.find_spec; u.find_spec = lambda name: None if name == "rclpy" else find(name); '
        f'sys.argv = ["vpr_node", *{args!r}]; from convseq_ros.node.__main__ import main; main()'
    )
    return run(sys.executable, '-c', code, timeout=180)


@pytest.mark.parametrize(
    ('words', 'code', 'told'),
    [
        ([], 1, 'ROS 2 is not installed or not sourced: source /opt'),
        (['-p', 'map_path:=map.db'], 2, '-p: parameters and remaps follow --ros-args\n'),
    ],
)
def test_the_node_without_ros_or_its_words_gives_the_remedy_in_one_line(words, code, told):
    result = node(*words)
    assert result.returncode == code and result.stderr.startswith(f'vpr_node: {told}')
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize('word', ['-h', '--help'])
def test_the_help_of_the_node_names_every_parameter_and_starts_nothing(word):
    result = node(word)
    assert result.returncode == 0 and not result.stderr
    for item in (*core_parameters(), *parameters(NodeConfig)):
        assert f'  {item.name} = ' in result.stdout
