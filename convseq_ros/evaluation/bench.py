# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs methods on data sets: everything that `convseq evaluate` does, as one function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import hashlib
from pathlib import Path

from convseq_ros.config import Config, flatten, KeyframeConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation import run_folder
from convseq_ros.evaluation.data_set import DataSet
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.method_name import MethodName, parse_method
from convseq_ros.evaluation.methods import make_method, Method
from convseq_ros.evaluation.protocols import CLOSED, ONLINE, OPEN, run_protocol, VERSION
from convseq_ros.evaluation.provenance import provenance
from convseq_ros.evaluation.query_answers import overridden
from convseq_ros.evaluation.scorecard import add_pcu, judge, summarize, Summary, threshold_figures
import numpy as np

DEFAULT_METHODS = ('convseq', 'convseq-k10', 'cohog', 'seqslam', 'hog')
PUBLISHED = 'published'
PAST = 'past'
Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run."""

    # As on the command line; `published` stands for the score matrices that a set comes with.
    methods: tuple[str, ...] = DEFAULT_METHODS
    # closed, open and past, for sets with a reference. `past` matches each drive against its own
    # past, forwards and backwards; no place is revisited.
    protocols: tuple[str, ...] = (CLOSED,)
    keep: float | None = None  # `open` keeps this share of the map, from its start
    criterion: str = 'score'  # threshold of the curves: score, margin or confidence
    export: Path | None = None  # folder for one JSON file per method and set
    argv: tuple[str, ...] = ()  # the command, for the record


def evaluate(
    data_sets: Sequence[DataSet],
    config: Config,
    plan: Plan,
    output: Path,
    report: Report = lambda _: None,
    warn: Report = lambda _: None,
) -> list[Summary]:
    """
    Run every method on every set, write the run folder, and return the summaries.

    `report` gets a line of progress, `warn` what is wrong with images.
    """
    names = [data_set.name for data_set in data_sets]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f'{name}: two data sets have this name; rename one')
    summaries: list[Summary] = []
    for data_set in data_sets:
        protocols: tuple[str, ...] = plan.protocols
        if data_set.online:
            protocols = (ONLINE,)
        elif PAST in protocols:
            for past in data_set.past_data_sets:
                summaries += _measure_set(past, (ONLINE,), config, plan, output, report, warn)
        protocols = tuple(protocol for protocol in protocols if protocol != PAST)
        summaries += _measure_set(data_set, protocols, config, plan, output, report, warn)
    run_folder.write_summary_table(output, summaries)
    if plan.export is not None:
        run_folder.write_exports(plan.export, summaries)
    return summaries


def method_names(texts: Sequence[str], data_set: DataSet) -> list[MethodName]:
    """Return the methods for a set; ConfigError if one is unclear or twice there."""
    names = []
    for text in texts:
        if text == PUBLISHED:
            for label, path in data_set.published.items():
                for suffix, length in (('', 1), ('-k10', 10), ('-dynamic', 0)):
                    names.append(MethodName(label + suffix, 'scores', str(path), length))
        else:
            names.append(parse_method(text))
    if not names:
        raise ConfigError(f'{data_set.name}: has no published scores; name another method')
    labels = [name.label for name in names]
    for label in labels:
        if labels.count(label) > 1:
            raise ConfigError(f'{label}: two methods have this label; write a label before =')
    of_growing_maps = () if data_set.online else {item.name for item in parameters(KeyframeConfig)}
    for name in names:
        for idle in name.options.keys() & of_growing_maps:
            raise ConfigError(
                f'method {name.label}: {idle} changes nothing, for every image of {data_set.name} '
                'is a place; leave it out'
            )
    return names


def _measure_set(
    data_set: DataSet,
    protocols: Sequence[str],
    config: Config,
    plan: Plan,
    output: Path,
    report: Report,
    warn: Report,
) -> list[Summary]:
    summaries: list[Summary] = []
    if not protocols:
        return summaries
    config = overridden(config, {'mode': 'online' if data_set.online else 'preloaded'})
    methods = [make_method(name, config) for name in method_names(plan.methods, data_set)]
    report(f'{data_set.name}: reading images')
    material = open_material(data_set, config.encoding, config.reading)
    for line in dict.fromkeys([*material.query.warnings, *material.reference.warnings]):
        warn(line)
    base = output / data_set.name
    run_folder.write_set(base, material)
    if protocols == (OPEN,):
        _describe_set(base, CLOSED, material)
    for protocol in protocols:
        name = f'{data_set.name}-open' if protocol == OPEN else data_set.name
        _describe_set(output / name, protocol, material, plan.keep)
        own = list[Summary]()
        for method in methods:
            report(f'{name}: {method.name.label}')
            own.append(_measure(material, method, protocol, output / name, plan))
        add_pcu(own)
        for summary in own:  # with it, the run of a method is complete
            run_folder.write_json(output / name / summary['method'] / 'summary.json', summary)
        summaries += own
    return summaries


def _measure(
    material: Material, method: Method, protocol: str, folder: Path, plan: Plan
) -> Summary:
    outcome = run_protocol(material, method, protocol, plan.keep)
    verdicts = judge(outcome)
    answerable = int((verdicts.matched & verdicts.known).sum())
    curve = verdicts.curve(plan.criterion, answerable)
    summary = {
        'set': folder.name,
        'method': method.name.label,
        'protocol_version': VERSION,
        'images': {
            'query': material.query.sha256,
            'reference': None if material.data_set.online else material.reference.sha256,
        },
        'truth': hashlib.sha256(np.packbits(outcome.right).tobytes()).hexdigest(),
        **summarize(outcome, verdicts, plan.criterion),
        'configuration': {
            'kind': method.name.kind,
            'argument': method.name.argument,
            'options': dict(method.name.options),
            **flatten(method.config),
        },
        **provenance(),
        'argv': list(plan.argv),
        **threshold_figures(verdicts, outcome.halves),
    }
    run_folder.write_run(folder / method.name.label, outcome, verdicts, curve)
    return summary


def _describe_set(
    folder: Path, protocol: str, material: Material, keep: float | None = None
) -> None:
    data_set, removed = material.data_set, ''
    if protocol == OPEN:
        removed = ', half of the map removed'
        if keep is not None:
            removed = f', first {keep:.0%} of the map kept'
    queries, references = material.truth.right.shape
    description = {
        'name': folder.name,
        'title': data_set.title + removed,
        'protocol': protocol,
        'truth': data_set.truth.kind,
        'tolerance': data_set.truth.tolerance,
        'radius_m': data_set.truth.radius_m or None,
        'exclude_recent': data_set.exclude_recent if data_set.online else None,
        'queries': queries,
        'references': references,
        'query': str(data_set.query),
        'reference': str(data_set.reference) if data_set.reference else None,
        'source': data_set.source,
        'base': data_set.name if protocol == OPEN else None,
    }
    run_folder.write_json(folder / 'set.json', description)
