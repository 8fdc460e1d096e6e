# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What others build on is what docs/STABILITY.md promises: a change of it is seen, and is meant.

`public_surface.json` is made from the code: CONVSEQ_SURFACE=write pytest THIS-FILE makes it anew.
The policy for SROS 2 allows what the node does, and nothing else.
"""

import argparse
from collections.abc import Iterator
import dataclasses
from enum import EnumType
import importlib
import inspect
import json
import os
from pathlib import Path
from typing import Any, get_args, get_type_hints
from xml.etree import ElementTree

import convseq_ros
from convseq_ros.app.result_row import COLUMNS
from convseq_ros.cli import COMMANDS
from convseq_ros.config import core_parameters
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.core.map.format import APPLICATION_ID, FORMAT_VERSION, TABLES
import pytest

KEPT = Path(__file__).resolve().parents[1] / 'golden' / 'public_surface.json'
STABLE, MAY_CHANGE = 'stable', 'may change'
# Everything that is not named here is stable.
CHANGING = {
    '/diagnostics', '~/debug_image', '~/markers', '~/reference_path',
    'PlaceRecognizer(matcher)', 'PlaceRecognizer.process(descriptor)',
    'open_map(encoding)', 'open_map(keyframes)',
    'build_map(links)',
    'convseq demo', 'convseq evaluate', 'convseq fleet', 'convseq report',
}  # fmt: skip
# What every node of ROS has: topics, TF's where it is installed, and packages of services' types.
OF_ROS = {'/rosout', '/parameter_events', '/clock', '/tf', '/tf_static'}
OF_EVERY_NODE = {'rcl_interfaces', 'type_description_interfaces'}


def classes(hint: Any) -> Iterator[type]:
    """Yield the records and words of this package that a type names."""
    if isinstance(hint, type) and hint.__module__.startswith('convseq_ros.core.types'):
        yield hint
    for part in get_args(hint):
        yield from classes(part)


def records() -> dict[str, type]:
    """Return the records that go into the six names and come out of them, by name."""
    found, asked = {}, [convseq_ros.Frame, convseq_ros.Match]
    while asked:
        one = asked.pop()
        if found.setdefault(one.__name__, one) is one and dataclasses.is_dataclass(one):
            told = [each.fget for each in vars(one).values() if isinstance(each, property)]
            returned = [get_type_hints(each).get('return') for each in told if each]
            hints = [*get_type_hints(one).values(), *returned]
            asked += [
                each for hint in hints for each in classes(hint) if each.__name__ not in found
            ]
    return found


def members() -> Iterator[str]:
    """Yield fields and properties of records, and words of enumerations."""
    for name, one in records().items():
        if isinstance(one, EnumType):
            yield from (f'{name}.{word.name} = {word.value}' for word in one)
            continue
        yield from (f'{name}.{item.name}' for item in dataclasses.fields(one))
        for member, value in vars(one).items():
            if isinstance(value, property):
                yield f'{name}.{member}'


def arguments() -> Iterator[str]:
    """Yield the arguments of the functions and methods."""
    for name in sorted({*convseq_ros.__all__} - {'Config', 'Frame', 'Match'}):
        one = getattr(convseq_ros, name)
        called = {name: one}
        if isinstance(one, type):
            methods = inspect.getmembers(one, inspect.isfunction)
            called |= {f'{name}.{key}': each for key, each in methods if not key.startswith('_')}
        for place, function in called.items():
            given = [key for key in inspect.signature(function).parameters if key != 'self']
            yield from (f'{place}({key})' for key in given or [''])


def options(parser: argparse.ArgumentParser, command: str) -> Iterator[str]:
    """Yield the arguments of a command and of its verbs."""
    for action in parser._actions:
        if action.nargs == argparse.PARSER:
            for verb, own in (action.choices or {}).items():
                yield from options(own, f'{command} {verb}')
        elif action.dest != 'help':
            yield from (f'{command} {one}' for one in action.option_strings if one[1] == '-')


def commands() -> Iterator[str]:
    """Yield each command and its options; parameters are listed once, elsewhere."""
    known = {f'--{item.name.replace("_", "-")}' for item in core_parameters()}
    for name in COMMANDS:
        yield f'convseq {name}'
        module = importlib.import_module(f'convseq_ros.cli.{name.replace("-", "_")}')
        if hasattr(module, 'describe') and f'convseq {name}' not in CHANGING:
            module.describe(parser := argparse.ArgumentParser(add_help=False))
            own = options(parser, f'convseq {name}')
            yield from (one for one in own if one.split()[-1] not in known)


def settings() -> Iterator[str]:
    """Yield each parameter with its type, its unit and its choices."""
    for item in (*core_parameters(), *parameters(NodeConfig)):
        kind = ' | '.join(item.choices) or item.type.__name__
        yield f'{item.name}: {kind}{f", {item.unit}" if item.unit else ""}'


def messages() -> Iterator[str]:
    """Yield the fields of the two messages that have fields of their own."""
    from convseq_ros.node.conversions import CANDIDATE, cloud_fields
    from convseq_ros.node.outputs.closure_messages import CLOSURE

    for topic, row in (('~/closure', CLOSURE), ('~/candidates', CANDIDATE)):
        for item in cloud_fields(row):
            yield f'{topic} {item.name} {item.datatype} x {item.count}'


def on_the_graph(client: Any, vpr: Any) -> dict[str, list[str]]:
    """Return the topics and services of a node that has all of them."""
    node = vpr(publish_initial_pose='true', publish_tf='true')
    who = node.get_name(), node.get_namespace()

    def told(find: Any) -> list[str]:
        return [
            f'{name.replace("/vpr_node/", "~/")} {" ".join(kinds)}'
            for name, kinds in find(*who)
            if name not in OF_ROS
            and not OF_EVERY_NODE & {kind.partition('/')[0] for kind in kinds}
        ]

    find_subscribed = node.get_subscriber_names_and_types_by_node
    client.wait_for(
        lambda: len(told(find_subscribed)) == len(['image', 'camera_info', 'odom', 'initialpose'])
    )
    return {
        'publishes': told(node.get_publisher_names_and_types_by_node),
        'subscribes': told(find_subscribed),
        'services': told(node.get_service_names_and_types_by_node),
    }


def changing(line: str) -> bool:
    """Return whether a line of the surface is not promised."""
    return any(line == one or line.startswith(f'{one} ') for one in CHANGING)


@pytest.fixture
def surface(client: Any, vpr: Any) -> dict[str, dict[str, list[str]]]:
    """Return all that is public, by what it is."""
    found = {
        'python': [*arguments()],
        'records': [*members()],
        **on_the_graph(client, vpr),
        'messages': [*messages()],
        'columns': [*COLUMNS],
        'parameters': [*settings()],
        'commands': [*commands()],
        'map file': [
            f'format {FORMAT_VERSION}, application id {APPLICATION_ID:#x}',
            *(f'{name} {columns}' for name, columns in TABLES.items()),
        ],
    }
    ordered = {'columns', 'messages'}  # readers may go by their places, too
    parts: dict[str, dict[str, list[str]]] = {STABLE: {}, MAY_CHANGE: {}}
    for kind, lines in found.items():
        for line in lines if kind in ordered else sorted(lines):
            parts[MAY_CHANGE if changing(line) else STABLE].setdefault(kind, []).append(line)
    return parts


def test_the_public_surface_is_as_promised(surface):
    """Whoever changes a stable line breaks somebody; `may change` is told in the changelog."""
    if os.environ.get('CONVSEQ_SURFACE') == 'write':
        KEPT.write_text(json.dumps(surface, indent=1) + '\n', encoding='utf-8')
    assert surface == json.loads(KEPT.read_text(encoding='utf-8'))
    told = [line for lines in surface[MAY_CHANGE].values() for line in lines]
    assert not [one for one in CHANGING if not any(line.startswith(one) for line in told)]


POLICY = Path(__file__).resolve().parents[2] / 'config' / 'sros2_policy.xml'
# With `use_sim_time`, with `image_transport: compressed`, and where ROS has TF, as PyPI has not.
SOMETIMES = {'/clock', '/image/compressed', '/tf', '/tf_static'}


def allowed(group, kind):
    (profile,) = ElementTree.parse(POLICY).getroot().iter('profile')
    names = [one.text for part in profile.findall(group) for one in part if part.get(kind)]
    assert len(names) == len(set(names))
    assert {part.get(kind) for part in profile.findall(group)} <= {'ALLOW', None}
    return set(names)


def test_the_security_policy_allows_exactly_the_topics_and_services_in_use(client, vpr):
    # With all that only some nodes have.
    node = vpr(lifecycle='true', publish_initial_pose='true', publish_tf='true')
    assert node.trigger_configure().name == 'SUCCESS'
    assert node.trigger_activate().name == 'SUCCESS'
    who = node.get_name(), node.get_namespace()

    def used(found):
        return {name for name, _ in found(*who)}

    client.wait_for(lambda: '/image' in used(node.get_subscriber_names_and_types_by_node))
    subscribed = used(node.get_subscriber_names_and_types_by_node)
    assert allowed('topics', 'subscribe') == subscribed | SOMETIMES
    published = used(node.get_publisher_names_and_types_by_node)
    assert allowed('topics', 'publish') == published | {'/tf'}
    assert allowed('services', 'reply') == used(node.get_service_names_and_types_by_node)
    assert not used(node.get_client_names_and_types_by_node)


def test_invalid_security_files_end_the_start_with_an_error(start, tmp_path):
    enclave = tmp_path / 'enclaves' / 'vpr_node'
    enclave.mkdir(parents=True)
    certificates = 'identity_ca.cert.pem cert.pem key.pem permissions_ca.cert.pem'
    for name in f'{certificates} governance.p7s permissions.p7s'.split():
        (enclave / name).touch()
    security = {'ENABLE': 'true', 'STRATEGY': 'Enforce', 'KEYSTORE': str(tmp_path)}
    environment = os.environ | {f'ROS_SECURITY_{name}': one for name, one in security.items()}
    words = '--ros-args', '--enclave', '/vpr_node'
    process = start('__main__', *words, environment=environment)
    _, errors = process.communicate(timeout=180)
    assert process.returncode == 1 and 'Traceback' not in errors
    # What rcl tells of its own accord is information.
    lines = [line for line in errors.splitlines() if '[INFO]' not in line]
    assert '[ERROR]' in lines[-1]
