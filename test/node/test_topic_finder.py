# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search for topics goes on until it is settled, and ends the same in any order of start."""

from itertools import permutations
from unittest.mock import Mock

from convseq_ros.node import topic_finder
from convseq_ros.node.offers import CAMERA_INFO, IMAGE, ODOMETRY, Offer
from convseq_ros.node.topic_finder import TopicFinder
import pytest


class Graph:
    """What a finder sees, and the changes that it asked for."""

    def __init__(self, monkeypatch, namespace='/', remapped=(), **options):
        self.offers, self.changes = [], []
        names = {'image': 'image', 'camera_info': 'camera_info', 'odom': 'odom', **dict(remapped)}
        prefix = f'{namespace.rstrip("/")}/'
        self.node = Mock(
            get_namespace=lambda: namespace,
            resolve_topic_name=lambda name: (
                it if (it := names.get(name, name)).startswith('/') else f'{prefix}{it}'
            ),
        )
        self.warning = self.node.get_logger.return_value.warning
        monkeypatch.setattr(topic_finder, 'offers_of', lambda _node: [*self.offers])
        self.finder = TopicFinder(self.node, self.changes.append, **options)

    def add(self, topic, kind=IMAGE):
        self.offers.append(Offer(topic, kind))
        self.look()

    def remove(self, topic):
        self.offers = [offer for offer in self.offers if offer.topic != topic]
        self.look()

    def look(self):
        for _ in range(2):
            self.finder._search()

    @property
    def used(self):
        return self.finder._used


@pytest.fixture
def graph(monkeypatch):
    return lambda *args, **options: Graph(monkeypatch, *args, **options)


STARTS = [
    [Offer('/robot1/lidar/nearir_image', IMAGE)],
    [Offer('/robot1/camera/image_raw', IMAGE)],
    [Offer('/robot1/camera/camera_info', CAMERA_INFO)],
    [Offer('/robot1/wheels/odom', ODOMETRY)],
    [Offer('/robot2/camera/image_raw', IMAGE), Offer('/robot2/odom', ODOMETRY)],
]


def test_every_order_of_start_ends_with_the_robots_own_topics(graph):
    for order in permutations(STARTS):
        world = graph('/robot1')
        for start in order:
            world.offers += start
            world.look()
        assert world.used == {
            'image': '/robot1/camera/image_raw',
            'camera_info': '/robot1/camera/camera_info',
            'odom': '/robot1/wheels/odom',
        }


def test_a_topic_is_used_when_two_looks_agree(graph):
    world = graph()
    world.offers = [Offer('/a/image_raw', IMAGE)]
    world.finder._search()
    assert not world.changes
    world.finder._search()
    assert [change.topics for change in world.changes] == [{'image': '/a/image_raw'}]


def test_only_a_topic_change_that_replaces_a_wrong_one_removes_its_data(graph):
    world = graph()
    world.add('/lidar/nearir_image')
    world.add('/wheels/odom', ODOMETRY)
    world.add('/odom', ODOMETRY)
    world.add('/camera/image_raw')
    assert [(dict(change.topics), change.gives_up) for change in world.changes] == [
        ({'image': '/lidar/nearir_image'}, True),  # nothing was heard before
        ({'odom': '/wheels/odom'}, False),
        ({'odom': '/odom'}, True),
        ({'image': '/camera/image_raw'}, True),
    ]
    assert world.changes[-1].text == (
        'found image on /camera/image_raw instead of /lidar/nearir_image; to choose another, '
        '-r NAME:=TOPIC'
    )


def test_an_abandoned_cameras_calibration_is_abandoned_too(graph):
    world = graph()
    world.add('/lidar/camera_info', CAMERA_INFO)
    world.add('/lidar/nearir_image')
    assert world.used['camera_info'] == '/lidar/camera_info'
    world.add('/camera/image_raw')
    assert world.used['camera_info'] == '/camera_info'


def test_topics_that_stopped_are_waited_for_unless_better_ones_come(graph):
    world = graph()
    world.add('/camera/camera_info', CAMERA_INFO)
    world.add('/camera/image_raw')
    before = dict(world.used)
    for topic in ('/camera/image_raw', '/camera/camera_info'):
        world.remove(topic)
    world.add('/lidar/nearir_image')
    world.add('/lidar/camera_info', CAMERA_INFO)
    assert world.used == before
    world.add('/front/color/image_raw')
    assert world.used['image'] == '/front/color/image_raw'


def test_a_camera_is_kept_once_the_search_is_settled(graph):
    world = graph()
    world.add('/lidar/nearir_image')
    world.finder.settle()
    world.add('/camera/image_raw')
    assert world.used['image'] == '/lidar/nearir_image'
    assert world.finder._timer.cancel.called


def test_an_equal_camera_changes_nothing_and_is_logged_once(graph):
    world = graph()
    world.add('/right/image_raw')
    world.add('/left/image_raw')
    world.look()
    assert world.used['image'] == '/right/image_raw'
    world.warning.assert_called_once_with(
        'image: 2 topics could be meant; to use one: -r image:=/left/image_raw or '
        '-r image:=/right/image_raw'
    )


def test_two_better_cameras_do_not_replace_the_current_one(graph):
    world = graph()
    world.add('/lidar/nearir_image')
    world.offers += [Offer('/left/image_raw', IMAGE), Offer('/right/image_raw', IMAGE)]
    world.look()
    assert world.used['image'] == '/image'


@pytest.mark.parametrize(
    ('options', 'left'),
    [
        ({'remapped': {'image': '/mine/image_raw'}.items()}, ['camera_info', 'odom']),
        ({'image_topics': ['/mine/image_raw']}, ['camera_info', 'odom']),
        ({'image_topics': ['/mine/image_raw', '/rear']}, ['odom']),
        ({'remapped': {'image': '/mine', 'camera_info': '/i', 'odom': '/o'}.items()}, []),
    ],
)
def test_chosen_topics_stay_and_the_others_are_found(graph, options, left):
    world = graph(**options)
    before = dict(world.used)
    for topic in ('/mine/image_raw', '/other/image_raw'):
        world.add(topic)
    world.add('/mine/camera_info', CAMERA_INFO)
    world.add('/wheels/odom', ODOMETRY)
    found = {'camera_info': '/mine/camera_info', 'odom': '/wheels/odom'}
    assert world.used == before | {name: found[name] for name in left}
