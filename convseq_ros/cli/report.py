# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One table of the results of several runs: `convseq report RESULT...`."""

import argparse
from pathlib import Path

from convseq_ros.config.reading_config import add_reading, chosen_reading
from convseq_ros.evaluation.run_folder import read_summaries
from convseq_ros.evaluation.table import latex_of, table_of


def describe(parser: argparse.ArgumentParser) -> None:
    help_ = 'folder that `convseq evaluate --output` wrote, or a summary.json of one'
    parser.add_argument('result', type=Path, nargs='+', metavar='RESULT', help=help_)
    parser.add_argument('--latex', action='store_true', help='print the table as LaTeX')
    add_reading(parser)


def run(chosen: argparse.Namespace) -> int:
    """Print the table; refuse results of one set that cannot be compared."""
    summaries = read_summaries(chosen.result, chosen_reading(chosen))
    print(latex_of(summaries) if chosen.latex else table_of(summaries).to_string(index=False))
    return 0
