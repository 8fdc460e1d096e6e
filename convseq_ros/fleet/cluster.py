# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a fleet works: in this process, in others of this machine, or on a running cluster.

Dask unpickles what its peers send, so anyone who reaches a scheduler or worker can run code there.
Processes of this machine listen on 127.0.0.1 only; a cluster elsewhere is reached only by TLS.
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

_ANSWERS_WITHIN_S = 10.0  # a scheduler, at the first request
# Python that a worker runs first: it ignores Ctrl-C, and uses one core.
_FIRST = (
    'import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); import cv2; cv2.setNumThreads(1)'
)
_LOCAL = {
    # Maps and cells hardly compress.
    'distributed.comm.compression': False,
    # A worker that is busy in C for long does not answer, but is not dead.
    'distributed.scheduler.worker-ttl': '5 minutes',
    'distributed.admin.tick.limit': '60s',
    # The nanny restarts a worker that died. This long after a death, Dask would close a worker of
    # the same name that is just being restarted after another death.
    'distributed.deploy.lost-worker-timeout': '1 day',
    # By default Dask samples its workers a hundred times a second, and their delays fifty times.
    'distributed.worker.profile.enabled': False,
    'distributed.admin.system-monitor.interval': '10s',
    'distributed.admin.tick.interval': '1s',
    # No web pages: the port that Dask opens for them serves nothing.
    'distributed.scheduler.http.routes': [],
    'distributed.worker.http.routes': [],
}


@dataclass(frozen=True, slots=True)
class Cluster:
    """Which workers to use: those of a scheduler or, without one, `workers` on this machine."""

    scheduler: str = (
        ''  # tcp://host:port, or tls://host:port with the certificates that Dask knows
    )
    workers: int = 1
    are_threads: bool = False  # of this process, if no scheduler is named


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
    """Return workers on this machine; FleetError if they do not start at the second try."""
    import distributed

    workers = cluster.workers
    kind: dict[str, Any] = {'host': '127.0.0.1', 'preload': _FIRST}
    if cluster.are_threads:
        # Dask opens a port for web pages, although there are none; by default to everybody.
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
                cause = error.__cause__ or error
                line = ' '.join(f'{error} {type(cause).__name__}: {cause}'.split())[:200]
                raise FleetError(f'{workers} workers did not start ({line}); try fewer') from None
    raise AssertionError('the last try returns or raises')


def checked_address(cluster: Cluster) -> str:
    """Return a scheduler's address, '' if none is named; FleetError if invalid or without TLS."""
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
    """Raise a FleetError unless all workers have this version of this package."""
    try:
        client.wait_for_workers(1, timeout=_ANSWERS_WITHIN_S)
        versions = client.run(version)
    except TimeoutError:
        raise FleetError(
            f'{scheduler}: has no workers; start some: dask worker {scheduler}'
        ) from None
    except ImportError as error:
        raise FleetError(f'{scheduler}: a worker lacks this package ({error})') from None
    for worker, installed in versions.items():
        if installed != __version__:
            raise FleetError(
                f'{scheduler}: worker {worker} has convseq_ros {installed}, this is '
                f'{__version__}; install the same'
            )


def finished_jobs(
    client: Any, work: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """Yield the name of each finished job with the result of its work, or its ConvseqError."""
    from distributed import as_completed, KilledWorker

    futures = {client.submit(_tried, work, job, pure=False): name for name, job in jobs.items()}
    for future in as_completed(futures):
        try:
            yield futures[future], future.result()
        except KilledWorker as error:
            died = FleetError(f'its worker died {error.allowed_failures + 1} times')
            yield futures[future], died


def _tried(work: Callable[..., Any], job: tuple[Any, ...]) -> Any:
    """Return the result of work, or its error, whose traceback Dask would print otherwise."""
    try:
        return work(*job)
    except ConvseqError as error:
        return error
    except OSError as error:
        return FleetError(f'{error.filename or ""}: {error.strerror}')
