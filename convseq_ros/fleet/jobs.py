# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Independent pieces of work, shared out among the workers of a fleet."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from convseq_ros.errors import ConvseqError, FleetError


def done(
    client: Any, work: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """
    Yield the name of each job, as it is done, with what the work returned or the ConvseqError.

    Jobs are the arguments of the work. Those of a worker that dies go to another; FleetError for
    one whose workers die again and again.
    """
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
