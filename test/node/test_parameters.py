# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node are those of config.py, checked at start and when set."""

from convseq_ros.config import Config, core_parameters
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.errors import ConfigError
from convseq_ros.node.services.parameters import declare, declare_group, KNOWN
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

ALL = [*core_parameters(), *parameters(NodeConfig)]


class Declared(Node):
    """A node that has nothing but parameters."""

    def __init__(self, context, *ros_args):
        super().__init__(
            'node',
            context=context,
            cli_args=['--ros-args', *ros_args],
            automatically_declare_parameters_from_overrides=True,
        )
        self.changes = []
        self.config, self.node_config = declare(self, self.note)

    def note(self, *configs):
        self.changes.append(configs)


@pytest.fixture
def declared(client):
    nodes = []

    def make(*ros_args):
        nodes.append(Declared(client.context, *ros_args))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def set_one(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


def test_every_parameter_has_its_default_and_is_described_with_unit_and_bounds(declared):
    node = declared()
    assert (node.config, node.node_config) == (Config(), NodeConfig())
    for item in ALL:
        assert node.get_parameter(item.name).value == item.default
        descriptor = node.describe_parameter(item.name)
        assert item.doc in descriptor.description
        assert item.unit in descriptor.description
        assert descriptor.read_only == (not item.dynamic)
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if item.low is not None:
            assert (ranges[0].from_value, ranges[0].to_value) == (item.low, item.high)
        if item.choices:
            assert item.choices[0] in descriptor.additional_constraints


@pytest.mark.parametrize('text', ['1', '1.0'])
def test_a_whole_number_will_do_for_a_float(declared, text):
    node = declared('-p', f'min_margin:={text}')
    assert node.config.acceptance.min_margin == 1.0
    assert node.get_parameter('min_margin').type_ is Parameter.Type.DOUBLE
    assert set_one(node, 'min_confidence', 1).successful
    assert node.get_parameter('min_confidence').value == 1.0


@pytest.mark.parametrize(
    ('argument', 'reason'),
    [
        ('min_margim:=0.1', "unknown parameter 'min_margim'; did you mean min_margin?"),
        ('nonsense.deep:=1', "unknown parameter 'nonsense.deep'"),
        ('min_evidence:=2.0', "unknown parameter 'min_evidence'; did you mean min_confidence?"),
        ('min_margin:=1.5', 'min_margin: 1.5 is outside 0 .. 1'),
        ('queue_size:=0', 'queue_size: 0 is outside 1 .. 10000'),
        ('queue_size:=many', "queue_size: expected int, got 'many'"),
        ('queue_size:=2.5', 'queue_size: expected int, got 2.5'),
        ('mode:=lifelong', "mode: 'lifelong' is not one of preloaded, online"),
        ('search:=cuda', "search: 'cuda' is not one of exhaustive, shortlist"),
        ('image_topics:=/a//b', "image_topics: '/a//b' is no name of a topic; give one such as"),
        ('image_size_px:=500', 'image_size_px: 500 is not a multiple'),
    ],
)
def test_a_wrong_initial_parameter_is_refused_in_one_line(declared, argument, reason):
    with pytest.raises(ConfigError) as error:
        declared('-p', argument)
    assert reason in str(error.value)
    assert '\n' not in str(error.value)


def test_parameters_of_ros_itself_are_accepted(declared):
    others = 'start_type_description_service:=false', 'qos_overrides./clock.subscription.depth:=3'
    node = declared(*(word for one in ('use_sim_time:=true', *others) for word in ('-p', one)))
    assert node.get_parameter('use_sim_time').value is True


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('min_margin', 1.5, 'range'),
        ('fixed_length', -1, 'range'),
        ('fixed_length', 2.5, 'type'),
        ('search', 'exhaustive', 'read-only'),
        ('map_path', 'other.db', 'read-only'),
        ('min_margin', float('nan'), 'range'),
    ],
)
def test_a_wrong_setting_is_refused_with_its_reason(declared, name, value, reason):
    node = declared()
    before = node.get_parameter(name).value
    result = set_one(node, name, value)
    assert not result.successful
    assert reason in result.reason
    assert node.get_parameter(name).value == before
    assert not node.changes


def test_the_clock_cannot_be_exchanged_while_the_node_runs_and_nothing_be_deleted(declared):
    node = declared()
    assert set_one(node, 'use_sim_time', False).successful
    told = 'use_sim_time may only be set at the start: -p use_sim_time:=true'
    assert set_one(node, 'use_sim_time', True) == SetParametersResult(reason=told)
    assert '/clock' not in {each.topic_name for each in node.subscriptions}
    assert not set_one(node, 'min_margin', None).successful
    assert node.get_parameter('min_margin').value == KNOWN['min_margin'].default


def test_a_node_of_one_group_refuses_the_clock_and_unknown_names_alike(client):
    node = Node(
        'node', context=client.context, automatically_declare_parameters_from_overrides=True
    )
    assert declare_group(node, PoseGraphConfig) == PoseGraphConfig()
    assert 'may only be set at the start' in set_one(node, 'use_sim_time', True).reason
    with pytest.raises(ParameterNotDeclaredException) as told:
        set_one(node, 'graph_spacing', 1.0)
    assert str(told.value) == "unknown parameter 'graph_spacing'; did you mean graph_spacing_m?"
    node.destroy_node()
