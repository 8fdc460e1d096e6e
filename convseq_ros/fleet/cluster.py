# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a fleet works: in this process, in others of this machine, or on a cluster that is running.

Dask unpickles what its peers send, so whoever reaches a scheduler or worker runs code there. Own
processes listen on 127.0.0.1 only; a cluster elsewhere is talked to by TLS alone.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
import ipaddress
import logging
import tempfile
from typing import Any

from convseq_ros import __version__
from convseq_ros.errors import ConvseqError, FleetError, one_line, pip_install

_ANSWERS_WITHIN_S = 10.0  # a scheduler, when it is asked first
# Python that a worker runs first: Ctrl-C is ours, and each core has a worker already.
_FIRST = (
    'import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); import cv2; cv2.setNumThreads(1)'
)
_LOCAL = {
    # Maps and cells are numbers that hardly shrink.
    'distributed.comm.compression': False,
    # A worker that is busy in C for long does not answer; it is not dead.
    'distributed.scheduler.worker-ttl': '5 minutes',
    'distributed.admin.tick.limit': '60s',
    # A worker that died is started again by its nanny. This long after one death Dask would close
    # whoever of that name is being started again just then, after another one.
    'distributed.deploy.lost-worker-timeout': '1 day',
    # Dask would look a hundred times a second at what its workers do, fifty at how late they are.
    'distributed.worker.profile.enabled': False,
    'distributed.admin.system-monitor.interval': '10s',
    'distributed.admin.tick.interval': '1s',
    # No pages: the port that Dask opens for them answers nothing.
    'distributed.scheduler.http.routes': [],
    'distributed.worker.http.routes': [],
}


@dataclass(frozen=True, slots=True)
class Cluster:
    """Which workers to use; `workers` of this machine, if no scheduler is named."""

    scheduler: str = (
        ''  # tcp://host:port, or tls://host:port with the certificates that Dask knows
    )
    workers: int = 1
    are_threads: bool = False  # workers of this machine: of this process


@contextmanager
def connected(cluster: Cluster) -> Iterator[Any]:
    """Yield a `distributed.Client` of a cluster; workers of this machine end with it."""
    try:
        import dask
        import distributed
    except ImportError:
        raise FleetError(f'a fleet needs dask.distributed; {pip_install("distributed")}') from None
    address, security = checked_address(cluster), None
    if address.startswith('tls:'):
        security = distributed.Security(require_encryption=True)  # as Dask is configured
        needed = 'tls_ca_file', 'tls_client_cert', 'tls_client_key'
        if not all(getattr(security, name) for name in needed):
            raise FleetError(
                f'{address}: TLS needs certificates; set ca-file, client.cert and client.key of '
                'distributed.comm.tls in the configuration of Dask (docs/tutorials/fleet.md)'
            )
    with ExitStack() as opened:
        opened.enter_context(dask.config.set(_LOCAL))
        if not address:
            folder = opened.enter_context(tempfile.TemporaryDirectory())
            address = opened.enter_context(_started(cluster, folder))
        try:
            client = distributed.Client(
                address, security=security, timeout=_ANSWERS_WITHIN_S, direct_to_workers=True
            )
        except (OSError, ValueError) as error:
            raise FleetError(
                f'{cluster.scheduler}: no scheduler answers ({one_line(error)})'
            ) from None
        opened.enter_context(client)
        if cluster.scheduler:
            _refuse_foreign(client, cluster.scheduler)
        yield client


def _started(cluster: Cluster, folder: str) -> Any:
    """Return workers of this machine; FleetError if they do not start, twice."""
    import distributed

    workers = cluster.workers
    kind: dict[str, Any] = {'host': '127.0.0.1', 'preload': _FIRST}
    if cluster.are_threads:
        # Dask opens ports for pages, of which there are none; by default to everybody.
        pages = '127.0.0.1:0'
        kind = {'processes': False, 'protocol': 'inproc://', 'worker_dashboard_address': pages}
    for last in (False, True):
        try:
            return distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                scheduler_kwargs={'dashboard': False, 'dashboard_address': '127.0.0.1:0'},
                silence_logs=logging.CRITICAL,
                memory_limit=0,
                local_directory=folder,
                **kind,
            )
        except (OSError, RuntimeError) as error:
            # Seen once, on a machine with six times as much to do as it has cores.
            if last:
                why = error.__cause__ or error
                what = ' '.join(f'{error} {type(why).__name__}: {why}'.split())[:200]
                raise FleetError(f'{workers} workers did not start ({what}); try fewer') from None
    raise AssertionError('the last try returns or raises')


def checked_address(cluster: Cluster) -> str:
    """Return a scheduler's address, '' if none is named; FleetError if it is none or needs TLS."""
    address = cluster.scheduler
    if not address:
        return ''
    protocol, _, where = address.partition('://')
    host, _, port = where.rpartition(':')
    if protocol not in ('tcp', 'tls') or not host or not port.isdecimal():
        raise FleetError(f'{address}: no address of a scheduler; give tcp://host:port')
    if protocol == 'tcp' and not _is_of_this_machine(host):
        raise FleetError(
            f'{address}: is not this machine, and Dask runs what its peers send: use TLS, '
            f'tls://{where}'
        )
    return address


def _is_of_this_machine(host: str) -> bool:
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False


def version() -> str:
    """Return this package's version, as a worker sees it."""
    return __version__


def _refuse_foreign(client: Any, scheduler: str) -> None:
    """FleetError unless all workers have this package in this version."""
    try:
        client.wait_for_workers(1, timeout=_ANSWERS_WITHIN_S)
        found = client.run(version)
    except TimeoutError:
        raise FleetError(
            f'{scheduler}: has no workers; start some: dask worker {scheduler}'
        ) from None
    except ImportError as error:
        raise FleetError(f'{scheduler}: a worker lacks this package ({error})') from None
    for worker, own in found.items():
        if own != __version__:
            raise FleetError(
                f'{scheduler}: worker {worker} has convseq_ros {own}, this is {__version__}; '
                'install the same'
            )


def done(
    client: Any, work: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """Yield the name of each job that is done, and what the work returned, or the ConvseqError."""
    from distributed import as_completed, KilledWorker

    futures = {client.submit(_tried, work, job, pure=False): name for name, job in jobs.items()}
    for future in as_completed(futures):
        try:
            yield futures[future], future.result()
        except KilledWorker as error:
            died = FleetError(f'its worker died {error.allowed_failures + 1} times')
            yield futures[future], died


def _tried(work: Callable[..., Any], job: tuple[Any, ...]) -> Any:
    """Return what a work returns, or its error, of which Dask would print the whole trace."""
    try:
        return work(*job)
    except ConvseqError as error:
        return error
    except OSError as error:
        return FleetError(f'{error.filename or ""}: {error.strerror}')
