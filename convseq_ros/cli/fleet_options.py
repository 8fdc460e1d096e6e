# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that say where a fleet works."""

import argparse

from convseq_ros.core.feature_cache import usable_cores
from convseq_ros.errors import FleetError
from convseq_ros.fleet.cluster import Cluster


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Declare the cluster's options."""
    group = parser.add_argument_group('cluster')
    group.add_argument(
        '--workers',
        type=int,
        metavar='N',
        help='workers on this machine (as many as it has cores); not with a scheduler',
    )
    group.add_argument(
        '--scheduler',
        default='',
        metavar='tcp://HOST:PORT',
        help='a running scheduler of Dask, whose workers see the same files, instead; on another '
        'machine tls://HOST:PORT, with the certificates in the configuration of Dask',
    )


def chosen_cluster(chosen: argparse.Namespace) -> Cluster:
    """Return the cluster that is asked for; FleetError if that makes no sense."""
    workers = chosen.workers
    if workers is not None and chosen.scheduler:
        raise FleetError('--workers is for this machine; a scheduler has its own')
    if workers is not None and workers < 1:
        raise FleetError(f'--workers {workers}: needs at least 1')
    return Cluster(chosen.scheduler, workers or usable_cores())
