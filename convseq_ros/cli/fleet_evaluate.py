# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run studies on the workers of a fleet: `convseq fleet evaluate STUDY...`."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from convseq_ros.cli.evaluate import add_run, run_studies
from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.progress import progress
from convseq_ros.fleet.cluster import connected
from convseq_ros.fleet.jobs import done


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        'study', type=Path, nargs='+', metavar='STUDY', help='YAML file, or a ready-made study'
    )
    add_cluster(parser)
    add_run(parser)


def run(chosen: argparse.Namespace) -> int:
    """Run them as `convseq evaluate --study` does, a row of a table a job."""
    chosen.sets = []
    # Workers may have another present folder.
    chosen.data_root, chosen.output = chosen.data_root.resolve(), chosen.output.resolve()
    chosen.cache = chosen.cache and chosen.cache.resolve()
    with connected(chosen_cluster(chosen)) as client:

        def each(
            measure: Callable[[Any], dict[str, Any]], pieces: Sequence[Any]
        ) -> Iterable[dict[str, Any]]:
            jobs = {str(number): (piece,) for number, piece in enumerate(pieces)}
            found = dict(progress(done(client, measure, jobs), len(jobs), 'study', 'rows'))
            for name in jobs:
                if isinstance(found[name], Exception):
                    raise found[name]
                yield found[name]

        return run_studies(chosen, each)
