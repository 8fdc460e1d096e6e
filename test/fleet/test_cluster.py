# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which schedulers are talked to, and how."""

import sys
from urllib.error import HTTPError
from urllib.request import urlopen

from convseq_ros.errors import FleetError
from convseq_ros.fleet.cluster import checked_address, Cluster, connected
import pytest


@pytest.mark.parametrize(
    'address', ['tcp://127.0.0.1:8786', 'tcp://localhost:8786', 'tcp://[::1]:8786']
)
def test_an_address_of_this_machine_needs_no_tls(address):
    assert checked_address(Cluster(address)) == address


@pytest.mark.parametrize(
    ('addresses', 'told'),
    [
        (
            'tcp://10.0.0.1:8786 tcp://robot:8786 tcp://0.0.0.0:8786 tcp://[::]:1',
            'use TLS, tls://',
        ),
        ('8786 http://127.0.0.1:8786 tcp://host tcp://:1', 'no address of a scheduler'),
    ],
)
def test_another_machine_without_tls_and_an_invalid_address_are_refused(addresses, told):
    for address in addresses.split():
        with pytest.raises(FleetError, match=told):
            checked_address(Cluster(address))


def test_another_machine_needs_tls_and_certificates():
    address = 'tls://10.0.0.1:8786'
    assert checked_address(Cluster(address)) == address
    pytest.importorskip('distributed')
    with pytest.raises(FleetError, match='TLS needs certificates; set ca-file'):
        with connected(Cluster(address)):
            pass


def test_a_missing_package_is_named_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(FleetError, match=r'pip install.*distributed'):
        with connected(Cluster()):
            pass


def test_workers_that_do_not_start_are_retried_once_and_then_reported(monkeypatch):
    distributed, tries = pytest.importorskip('distributed'), []

    def fails(**_):
        tries.append(1)
        raise RuntimeError('Nanny failed to start.') from OSError('no room')

    monkeypatch.setattr(distributed, 'LocalCluster', fails)
    with pytest.raises(FleetError, match=r'^3 workers did not start \(.*OSError: no room\)'):
        with connected(Cluster(workers=3)):
            pass
    assert len(tries) == 2


def test_a_local_cluster_listens_on_this_machine_only(client):
    addresses = [client.scheduler.address, *client.scheduler_info()['workers']]
    assert len(addresses) == 3
    assert all(one.startswith('tcp://127.0.0.1:') for one in addresses)
    host, port = client.run_on_scheduler(
        lambda dask_scheduler: (
            dask_scheduler.http_server.address,
            dask_scheduler.http_server.port,
        )
    )
    assert host == '127.0.0.1'
    with pytest.raises(HTTPError, match='404'):
        urlopen(f'http://127.0.0.1:{port}/status')
