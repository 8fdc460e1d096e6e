# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One page of results, drawn by matplotlib: `convseq report RESULT... --output report.html`."""

import argparse
from pathlib import Path
import sys

from convseq_ros.cli.outputs import add_output
from convseq_ros.config.reading_config import add_reading, chosen_reading
from convseq_ros.evaluation.report.charts import write_figures
from convseq_ros.evaluation.report.page import write_report
from convseq_ros.evaluation.report.shown import read_runs
from convseq_ros.evaluation.run_folder import read_exports
from convseq_ros.evaluation.table import format_table, summary_rows
from convseq_ros.io.output_file import PAGE


def describe(parser: argparse.ArgumentParser) -> None:
    # A table of options reads better in few lines.
    # fmt: off
    parser.add_argument('result', type=Path, nargs='+', metavar='RESULT', help='folder that '
        '`convseq evaluate --output` wrote; or files that `--export` wrote, which are put in one '
        'table instead')
    add_output(parser, '--output', kinds=PAGE, default=Path('report.html'), metavar='FILE',
        help='the page (default: %(default)s)')
    parser.add_argument('--figures', type=Path, metavar='FOLDER', help='also write every chart as '
        'PNG, SVG and PDF')
    # fmt: on
    add_reading(parser)


def run(chosen: argparse.Namespace) -> int:
    """Write the page, and the figures if they are wanted; or print a table of exports."""
    if all(path.suffix == '.json' for path in chosen.result):
        exports = read_exports(chosen.result, chosen_reading(chosen))
        print(format_table(summary_rows(exports)))
        return 0
    runs = read_runs(chosen.result, chosen_reading(chosen))
    write_report(runs, chosen.output)
    size = chosen.output.stat().st_size / 1e6
    print(f'{chosen.output}: {len(runs)} runs, {size:.1f} MB', file=sys.stderr)
    if chosen.figures:
        write_figures(runs, chosen.figures)
        print(f'{chosen.figures}: figures as PNG, SVG and PDF', file=sys.stderr)
    return 0
