# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn street, its map, a client on the ROS graph, and processes of ours."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib.util import find_spec
import os
from pathlib import Path
import subprocess
import sys
import threading
import time
from typing import Any

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
import numpy as np
from pictures import walls
import pytest
from world import street_of

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_*.py']

# Fast DDS makes itself known in its first half second, then every 3 s, and asks every 3 s what has
# not arrived; here it shall be sooner.
# Within a process it would hand messages over directly, and lose those that come too early.
DISCOVERY = """
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <library_settings><intraprocess_delivery>OFF</intraprocess_delivery></library_settings>
  <participant profile_name="quick_discovery" is_default_profile="true">
    <rtps><builtin><discovery_config>
      <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
    </discovery_config></builtin></rtps>
  </participant>
  <data_writer profile_name="quick_repair" is_default_profile="true">
    <times><heartbeatPeriod><sec>0</sec><nanosec>100000000</nanosec></heartbeatPeriod></times>
  </data_writer>
</profiles>
"""
SECOND = 1_000_000_000
# Quick, sure of single frames, in no hurry, and not to be changed with the defaults.
SETTINGS = {'matching': 'regional', 'search': 'exhaustive', 'max_wait_s': 0.0}


def words_of(parameters: dict[str, Any]) -> list[str]:
    """Return what sets parameters on a command line of ROS."""
    return [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]


@pytest.fixture(scope='session', autouse=True)
def quick_discovery(tmp_path_factory) -> Iterator[None]:
    """Have nodes find each other without waiting."""
    profile = tmp_path_factory.mktemp('dds') / 'quick_discovery.xml'
    profile.write_text(DISCOVERY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', str(profile))
        yield


@pytest.fixture
def held(monkeypatch) -> Iterator[threading.Event]:
    """Let every frame wait for this event."""
    from convseq_ros.core.recognizer import PlaceRecognizer

    quick, event = PlaceRecognizer.process, threading.Event()

    def process(recognizer: PlaceRecognizer, frame: Any) -> Any:
        assert event.wait(60)
        return quick(recognizer, frame)

    monkeypatch.setattr(PlaceRecognizer, 'process', process)
    yield event
    event.set()


@pytest.fixture(scope='session')
def street() -> list[np.ndarray]:
    """Return grey pictures (120, 160) that have nothing in common."""
    return walls(25)


@pytest.fixture(scope='session')
def street_map(street) -> ReferenceMap:
    """Return a map of the street: a place every second, one metre apart."""
    return street_of(street, SECOND)


@pytest.fixture(scope='session')
def map_path(street_map, tmp_path_factory) -> Path:
    """Return the file of the map of the street."""
    path = tmp_path_factory.mktemp('map') / 'street.db'
    save_map(street_map, path)
    return path


class Client:
    """A node that publishes, listens and waits for what others do."""

    def __init__(self, context: Any) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        self.context = context
        self.node = Node('client', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)

    def wait_for(
        self, condition: Callable[[], Any], what: str = '', timeout_s: float = 180
    ) -> Any:
        """
        Spin until the condition holds, and return what it returned.

        It may look at the newest message: as long as there is none, it does not hold.
        """

        def asked() -> Any:
            with suppress(IndexError):
                return condition()

        deadline_s = time.monotonic() + timeout_s
        while not (value := asked()):
            assert time.monotonic() < deadline_s, f'waited in vain: {what or condition}'
            self.executor.spin_once(timeout_sec=0.02)
        return value

    def wait_until_known_to(self, name: str) -> None:
        """
        Wait until a node knows all that this one has made; to know it does not mean to be known.

        It learns of them in the order in which they were made: who answers the last knows all.
        """
        from rcl_interfaces.srv import ListParameters

        service = self.node.create_client(ListParameters, f'{name}/list_parameters')
        self.wait_for(service.service_is_ready, service.srv_name)
        asked: list[Any] = []
        begun_s = time.monotonic()

        def answered() -> bool:
            # The answer is lost if the node does not know the client yet: ask every 0.3 s.
            if time.monotonic() >= begun_s + 0.3 * len(asked):
                asked.append(service.call_async(ListParameters.Request()))
            return any(future.done() for future in asked)

        self.wait_for(answered, f'{service.srv_name} to answer')
        self.node.destroy_client(service)

    def listen(self, kind: type, topic: str, qos: Any = 1000) -> list[Any]:
        """Return a list to which messages are appended; its publisher is there."""
        messages: list[Any] = []
        subscription = self.node.create_subscription(kind, topic, messages.append, qos)
        self.wait_for(subscription.get_publisher_count, f'a publisher of {topic}')
        return messages

    def camera(self, kind: type, topic: str = '/image', qos: Any = 1000) -> Any:
        """Return a publisher; its subscriber knows of it, and of whoever listens by now."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.wait_for(publisher.get_subscription_count, f'a subscriber of {topic}')

        def names() -> list[str]:
            ends = self.node.get_subscriptions_info_by_topic(topic)
            found = [f'{end.node_namespace.rstrip("/")}/{end.node_name}' for end in ends]
            return [] if any('UNKNOWN' in name for name in found) else found

        for name in self.wait_for(names, f'the name of a subscriber of {topic}'):
            self.wait_until_known_to(name)
        return publisher

    @staticmethod
    def values_of(message: Any) -> dict[str, str]:
        """Return what docs/TOPICS.md tells a subscriber of a DiagnosticArray to write."""
        return {pair.key: pair.value for pair in message.status[0].values}

    def service(self, kind: type, name: str) -> Any:
        """Return a client whose calls are answered."""
        service = self.node.create_client(kind, name)
        self.wait_for(service.service_is_ready, name)
        self.wait_until_known_to(name.rpartition('/')[0])
        return service

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Return the answer of a service."""
        future = self.service(kind, name).call_async(kind.Request(**fields))
        self.wait_for(future.done, name)
        return future.result()


@pytest.fixture
def client() -> Iterator[Client]:
    """Return a client in a ROS context of its own."""
    from rclpy.context import Context

    context = Context()
    context.init()
    client = Client(context)
    yield client
    client.node.destroy_node()
    client.executor.shutdown()
    context.try_shutdown()


@pytest.fixture
def vpr() -> Iterator[Callable[..., Any]]:
    """Return a maker of a VprNode in a thread of this process."""
    from convseq_ros.node.vpr_node import VprNode
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.context import Context
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    ended, threads = threading.Event(), []

    def make(*ros_args: str, **parameters: Any) -> VprNode:
        cli_args = ['--ros-args', *ros_args, *words_of(SETTINGS | parameters)]
        # Not the client's context: DDS allows only one type for a topic in each.
        context = Context()
        context.init()
        node = VprNode(context=context, cli_args=cli_args)

        def spin() -> None:
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
            try:
                while context.ok() and not ended.is_set():
                    executor.spin_once(timeout_sec=0.2)
            except (ExternalShutdownException, RCLError):
                # A test may shut its node's context down while this is about to wait.
                if context.ok():
                    raise
            node.destroy_node()
            executor.shutdown()
            # By the thread that spins: another one might do it while it is about to wait.
            context.try_shutdown()

        thread = threading.Thread(target=spin)
        thread.start()
        threads.append(thread)
        return node

    yield make
    ended.set()
    for thread in threads:
        thread.join()


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Return a starter of modules of `convseq_ros.node`; what still runs at the end is ended."""
    processes = []

    def run(
        module: str, *args: str, environment: Mapping[str, str] = os.environ, **parameters: Any
    ) -> subprocess.Popen[str]:
        if module == 'vpr_node':
            args = '--ros-args', *words_of(SETTINGS | parameters), *args
        processes.append(
            subprocess.Popen(
                [sys.executable, '-m', f'convseq_ros.node.{module}', *map(str, args)],
                cwd=tmp_path,
                env={**environment, 'PYTHONPATH': os.pathsep.join(sys.path)},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return processes[-1]

    yield run
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def image() -> Callable[..., Any]:
    """Return a maker of mono8 images."""
    from convseq_ros.node.conversions import image_message, stamp_from_ns
    from std_msgs.msg import Header

    def make(gray: np.ndarray, stamp_ns: int) -> Any:
        return image_message(gray, Header(stamp=stamp_from_ns(stamp_ns), frame_id='camera'))

    return make


@pytest.fixture
def show(client, street, image) -> Callable[..., int]:
    """Return a way to show places of the street, None for an unknown one; it tells the index."""
    from sensor_msgs.msg import Image
    from std_msgs.msg import Int32

    noise = np.random.default_rng(99).integers(0, 256, (50, *street[0].shape), np.uint8)
    heard: list[Any] = []
    cameras: list[Any] = []
    shown: list[int | None] = []

    def show(*places: int | None) -> int:
        if not cameras:
            heard.append(client.listen(Int32, '/vpr_node/match_index'))
            cameras.append(client.camera(Image))
        for place in places:
            shown.append(place)
            gray = noise[len(shown)] if place is None else street[place]
            cameras[0].publish(image(gray, len(shown) * SECOND))
            client.wait_for(lambda: len(heard[0]) == len(shown), 'an answer')
        return heard[0][-1].data

    return show
