# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts for RViz and Foxglove are valid, and show what the node publishes."""

import json
from pathlib import Path
import re

import pytest

pytest.importorskip('yaml')

from rclpy.topic_endpoint_info import TopicEndpointTypeEnum
import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config'
MOST_WANTED = {'debug_image', 'markers', 'reference_path'}
RVIZ_TYPES = {
    'rviz_default_plugins/Image': 'sensor_msgs/msg/Image',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
    'rviz_default_plugins/PoseWithCovariance': 'geometry_msgs/msg/PoseWithCovarianceStamped',
}


@pytest.fixture
def published(vpr):
    """Return what a node publishes: types and durability by name."""
    node = vpr()
    name, namespace = node.get_name(), node.get_namespace()
    topics = node.get_publisher_names_and_types_by_node(name, namespace)
    found = {}
    for topic, types in topics:
        (info,) = (
            info
            for info in node.get_publishers_info_by_topic(topic)
            if info.endpoint_type == TopicEndpointTypeEnum.PUBLISHER and info.node_name == name
        )
        found[topic] = types[0], info.qos_profile.durability.name
    return found


def test_rviz_shows_topics_of_the_node_with_their_types(published):
    layout = yaml.safe_load((CONFIG / 'convseq.rviz').read_text())
    displays = layout['Visualization Manager']['Displays']
    every = [display for display in displays if 'Topic' in display]
    shown = [one for one in every if one['Topic']['Value'] != '/pose_graph_node/path']
    assert len(shown) == len(every) - 1
    for display in shown:
        kind, durability = published[display['Topic']['Value']]
        assert kind == RVIZ_TYPES[display['Class']]
        wanted = display['Topic']['Durability Policy'].replace(' ', '_').upper()
        assert wanted in (durability, 'VOLATILE')
    names = {display['Topic']['Value'].rpartition('/')[2] for display in shown}
    assert names >= MOST_WANTED
    assert layout['Visualization Manager']['Global Options']['Fixed Frame'] == 'map'


def test_foxglove_shows_topics_of_the_node(published):
    text = (CONFIG / 'foxglove_layout.json').read_text()
    layout = json.loads(text)
    names = set(re.findall(r'"(/[a-z_/]+)(?:\.[a-z]+)?"', text))
    assert names <= published.keys()
    assert {name.rpartition('/')[2] for name in names} >= {*MOST_WANTED, 'diagnostics'}
    panels = set(re.findall(r'"([A-Za-z0-9]+!convseq)"', json.dumps(layout['layout'])))
    assert panels == layout['configById'].keys()


def test_namespaces_of_markers_are_those_that_are_drawn():
    source = (CONFIG.parent / 'convseq_ros' / 'node' / 'outputs' / 'map_topics.py').read_text()
    drawn = set(re.findall(r"_marker\(header, '(\w+)'", source))
    layout = yaml.safe_load((CONFIG / 'convseq.rviz').read_text())
    (display,) = (
        each
        for each in layout['Visualization Manager']['Displays']
        if each['Class'].endswith('/MarkerArray')
    )
    assert display['Namespaces'].keys() == drawn
    foxglove = json.loads((CONFIG / 'foxglove_layout.json').read_text())
    topics = foxglove['configById']['3D!convseq']['topics']
    assert topics['/vpr_node/markers']['namespaces'].keys() == drawn
