# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measure methods on data sets: `convseq evaluate SET... --output DIR`."""

import argparse
import json
from pathlib import Path
import sys

from convseq_ros.cli.options import add_config, chosen_config, warn
from convseq_ros.config import EVERY_FRAME
from convseq_ros.config.arguments import local
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.bench import DEFAULT_METHODS, evaluate, PAST, Plan, PUBLISHED
from convseq_ros.evaluation.data_set import open_data_set, ready_made
from convseq_ros.evaluation.methods import KINDS, Sweep
from convseq_ros.evaluation.protocols import CLOSED, OPEN
from convseq_ros.evaluation.run_folder import refuse_others, REPORT
from convseq_ros.evaluation.scorecard import CRITERIA
from convseq_ros.evaluation.table import table_of


def describe(parser: argparse.ArgumentParser) -> None:
    # A table of options reads better in few lines.
    # fmt: off
    parser.add_argument('sets', type=local, nargs='*', metavar='SET',
        help=f'data set: a YAML file, or one of {", ".join(ready_made())}')
    parser.add_argument('--method', action='append', metavar='METHOD',
        help=f"a name, one of {', '.join(KINDS)}, and options, such as 'convseq k=10 "
        f"label=ours'; or {PUBLISHED} for the score matrices that the set names; may be given "
        f"more than once (default {', '.join(DEFAULT_METHODS)}, {PUBLISHED})")
    parser.add_argument('--protocol', action='append', choices=(CLOSED, OPEN, PAST), help='the '
        'whole map, a part of it removed, or each drive against its own past; may be given more '
        'than once (default closed); a set without reference is always matched against its own '
        'past')
    parser.add_argument('--criterion', choices=CRITERIA, default='score',
        help='what curves are drawn over (score); accepted: the score of what a method accepts')
    parser.add_argument('--keep', type=float, metavar='SHARE', help='for the open protocol, keep '
        'this first part of the map, such as 0.7, instead of the first, the last and the middle '
        'half in turn')
    parser.add_argument('--sweep', metavar='OPTION=A..B', help='run every method (default paper) '
        'with each of these values, and draw a figure by them, such as k=1..20')
    parser.add_argument('--output', type=Path, default=Path('results'),
        help=f'run folder to write, with its page {REPORT} (results)')
    parser.add_argument('--data-root', type=Path, default=Path(), help='where the folders of '
        'ready-made sets are (the present folder)')
    parser.add_argument('--cache', type=Path, metavar='FOLDER', help='keep descriptors in this '
        'folder, and take those of the same images, settings and program from it')
    # fmt: on
    parser.add_argument('--json', action='store_true', help='print the summaries as JSON')
    add_config(parser)


def run(chosen: argparse.Namespace) -> int:
    """Evaluate, write the run folder, and print the table."""
    # Ground truth refers to frame numbers, so every frame counts.
    config = chosen_config(chosen, EVERY_FRAME.spacing)
    if not chosen.sets:
        raise ConfigError(f'no data set; give a YAML file or one of {", ".join(ready_made())}')
    refuse_others('--output', chosen.output)
    protocols = chosen.protocol or (CLOSED if chosen.keep is None else OPEN,)
    if chosen.keep is not None and not (0 < chosen.keep < 1 and OPEN in protocols):
        raise ConfigError(
            f'--keep: {chosen.keep:g} is not a share between 0 and 1 for --protocol open'
        )
    usual = ('paper',) if chosen.sweep else (*DEFAULT_METHODS, PUBLISHED)
    plan = Plan(
        methods=tuple(chosen.method or usual),
        protocols=tuple(dict.fromkeys(protocols)),
        keep=chosen.keep,
        criterion=chosen.criterion,
        cache=chosen.cache,
        sweep=Sweep.parse(chosen.sweep) if chosen.sweep else None,
        argv=tuple(sys.argv),
    )
    data_sets = [open_data_set(text, chosen.data_root, config.reading) for text in chosen.sets]
    summaries = evaluate(data_sets, config, plan, chosen.output, _say, warn)
    print(json.dumps(summaries) if chosen.json else table_of(summaries).to_string(index=False))
    return 0


def _say(text: str) -> None:
    if sys.stderr.isatty():
        print(text, file=sys.stderr)
