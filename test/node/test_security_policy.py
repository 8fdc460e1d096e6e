# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS 2 allows what the node does, and nothing else."""

import os
from pathlib import Path
import sys
from xml.etree import ElementTree

from programs import run

POLICY = Path(__file__).resolve().parents[2] / 'config' / 'sros2_policy.xml'
# Subscribed to with `use_sim_time`, and with `image_transport: compressed`.
SOMETIMES = {'/clock', '/image/compressed'}


def allowed(group, kind):
    (profile,) = ElementTree.parse(POLICY).getroot().iter('profile')
    names = [one.text for part in profile.findall(group) for one in part if part.get(kind)]
    assert len(names) == len(set(names))
    assert {part.get(kind) for part in profile.findall(group)} <= {'ALLOW', None}
    return set(names)


def test_the_policy_names_what_the_node_uses(client, vpr):
    # With all that only some nodes have.
    node = vpr(lifecycle='true', publish_initial_pose='true', fleet='tcp://127.0.0.1:1')
    assert node.trigger_configure().name == 'SUCCESS'
    assert node.trigger_activate().name == 'SUCCESS'
    who = node.get_name(), node.get_namespace()

    def used(found):
        return {name for name, _ in found(*who)}

    client.wait_for(lambda: '/image' in used(node.get_subscriber_names_and_types_by_node))
    subscribed = used(node.get_subscriber_names_and_types_by_node)
    assert allowed('topics', 'subscribe') == subscribed | SOMETIMES
    assert allowed('topics', 'publish') == used(node.get_publisher_names_and_types_by_node)
    assert allowed('services', 'reply') == used(node.get_service_names_and_types_by_node)
    assert not used(node.get_client_names_and_types_by_node)


def test_security_that_cannot_be_had_is_one_line(tmp_path):
    enclave = tmp_path / 'enclaves' / 'vpr_node'
    enclave.mkdir(parents=True)
    certificates = 'identity_ca.cert.pem cert.pem key.pem permissions_ca.cert.pem'
    for name in f'{certificates} governance.p7s permissions.p7s'.split():
        (enclave / name).touch()
    security = {'ENABLE': 'true', 'STRATEGY': 'Enforce', 'KEYSTORE': str(tmp_path)}
    done = run(
        sys.executable,
        '-m',
        'convseq_ros.node',
        '--ros-args',
        '--enclave',
        '/vpr_node',
        env=os.environ
        | {'PYTHONPATH': os.pathsep.join(sys.path)}
        | {f'ROS_SECURITY_{name}': value for name, value in security.items()},
        timeout=60,
    )
    assert done.returncode == 1
    # What rcl tells of its own accord is information.
    lines = [line for line in done.stderr.splitlines() if '[INFO]' not in line]
    assert '[ERROR]' in lines[-1]
    assert 'Traceback' not in done.stderr
