# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Workers of Dask on this machine, which build maps.

Dask unpickles what its peers send, so anyone who reaches a scheduler or worker can run code there.
Processes of this machine listen on 127.0.0.1 only.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import logging
import tempfile
from typing import Any

from convseq_ros.errors import ConvseqError, FleetError, load

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
    # No web pages: the port that Dask opens for them serves nothing.
    'distributed.scheduler.http.routes': [],
    'distributed.worker.http.routes': [],
}


@contextmanager
def started(workers: int) -> Iterator[Any]:
    """Yield a `distributed.Client` of so many processes of this machine, which end with it."""
    distributed, dask = (load(name, 'a fleet', FleetError) for name in ('distributed', 'dask'))
    with dask.config.set(_LOCAL), tempfile.TemporaryDirectory() as folder:
        try:
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                scheduler_kwargs={'dashboard': False, 'dashboard_address': '127.0.0.1:0'},
                silence_logs=logging.CRITICAL,
                memory_limit=0,
                local_directory=folder,
                host='127.0.0.1',
                preload=_FIRST,
            )
        except (OSError, RuntimeError) as error:
            line = ' '.join(f'{error} {error.__cause__ or ""}'.split())[:200]
            raise FleetError(f'{workers} workers did not start ({line}); try fewer') from None
        with cluster, distributed.Client(cluster) as client:
            yield client


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
