# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs methods on data sets: everything that `convseq evaluate` does, as one function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import hashlib
import json
from pathlib import Path

from convseq_ros.config import Config, flatten, KeyframeConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.errors import ConfigError, load
from convseq_ros.evaluation import run_folder
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.data_set import DataSet
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.methods import make_method, Method, MethodName, parse_method, Sweep
from convseq_ros.evaluation.protocols import CLOSED, ONLINE, OPEN, run_protocol, VERSION
from convseq_ros.evaluation.provenance import provenance
from convseq_ros.evaluation.query_answers import overridden
from convseq_ros.evaluation.report.page import Section, write_page
from convseq_ros.evaluation.report.results import Result, section_of
from convseq_ros.evaluation.scorecard import (
    difference,
    judge,
    summarize,
    Summary,
    threshold_figures,
)
from convseq_ros.evaluation.table import table_of
from convseq_ros.io.output_file import make_folder
import numpy as np

DEFAULT_METHODS = ('convseq', 'convseq k=10', 'cohog', 'seqslam', 'hog')
PUBLISHED = 'published'
PAST = 'past'
_MADE = 'argv', 'versions', 'criterion', 'configuration', 'k_distribution'
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
    cache: Path | None = None  # folder in which descriptors are kept between runs
    sweep: Sweep | None = None  # run every method with each of these values
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

    `report` gets a line of progress, `warn` what is wrong with images. ConvseqError if a library
    of the extra `evaluation` is missing.
    """
    for library in ('jinja2', 'matplotlib', 'pandas', 'sklearn'):
        load(library, 'evaluation')
    names = [data_set.name for data_set in data_sets]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f'{name}: two data sets have this name; rename one')
    for folder in filter(None, (plan.cache, output)):
        make_folder(folder)
    summaries, sections = list[Summary](), list[Section]()
    for data_set in data_sets:
        asked = [(data_set, protocol) for protocol in plan.protocols if protocol != PAST]
        if data_set.online:
            asked = [(data_set, ONLINE)]
        elif PAST in plan.protocols:
            asked = [*((past, ONLINE) for past in data_set.past_data_sets), *asked]
        for one, protocol in asked:
            found, section = _measure_set(one, protocol, config, plan, output, report, warn)
            summaries += found
            sections.append(section)
    run_folder.write_summary_table(output, summaries)
    table = table_of(summaries).to_html(index=False, border=0)
    made = {
        f'{one["set"]} / {one["method"]}': json.dumps({key: one[key] for key in _MADE}, indent=1)
        for one in summaries
    }
    title = 'Place recognition: ' + ', '.join(names)
    facts = f'{summaries[0]["date"][:10]} · {summaries[0]["machine"]["cpu"]}'
    write_page(output / run_folder.REPORT, title, facts, sections, made, table)
    return summaries


def method_names(texts: Sequence[str], data_set: DataSet) -> list[MethodName]:
    """Return the methods for a set; ConfigError if one is unclear or twice there."""
    names = []
    for text in texts:
        if text == PUBLISHED:
            for label, path in data_set.published.items():
                for suffix, length in (('', 1), ('-k10', 10), ('-dynamic', 0)):
                    options = {'file': str(path)}
                    names.append(MethodName(label + suffix, 'scores', options, length))
        else:
            names.append(parse_method(text))
    if not names:
        raise ConfigError(f'{data_set.name}: has no published scores; name another method')
    labels = [name.label for name in names]
    for label in labels:
        if labels.count(label) > 1:
            raise ConfigError(f'{label}: two methods have this label; add label=NAME')
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
    protocol: str,
    config: Config,
    plan: Plan,
    output: Path,
    report: Report,
    warn: Report,
) -> tuple[list[Summary], Section]:
    config = overridden(config, {'mode': 'online' if data_set.online else 'preloaded'})
    texts = plan.sweep.methods(plan.methods) if plan.sweep else plan.methods
    methods = [make_method(name, config) for name in method_names(texts, data_set)]
    report(f'{data_set.name}: reading images')
    cache = Cache(plan.cache, warn) if plan.cache else None
    material = open_material(data_set, config.encoding, config.reading, cache)
    for line in dict.fromkeys([*material.query.warnings, *material.reference.warnings]):
        warn(line)
    if material.unmissable:
        warn(
            f'{data_set.name}: for {material.unmissable} of {len(material.truth.right)} queries '
            'every place is right, so no answer is wrong; consider a smaller tolerance or radius_m'
        )
    name = f'{data_set.name}-open' if protocol == OPEN else data_set.name
    results = []
    for method in methods:
        report(f'{name}: {method.name.label}')
        results.append(_measure(material, method, protocol, name, plan))
    for one in results[1:]:
        one.summary['difference_from'] = results[0].summary['method']
        one.summary.update(difference(one.outcome, one.verdicts, results[0].verdicts))
    for one in results:
        folder = output / name / one.summary['method']
        run_folder.write_run(folder, one.outcome, one.verdicts, one.summary)
    section = section_of(material, config.encoding, results, plan.sweep)
    return [one.summary for one in results], section


def _measure(material: Material, method: Method, protocol: str, name: str, plan: Plan) -> Result:
    outcome = run_protocol(material, method, protocol, plan.keep)
    verdicts = judge(outcome)
    answerable = int((verdicts.matched & verdicts.known).sum())
    data_set, removed = material.data_set, ''
    if protocol == OPEN:
        removed = ', half of the map removed'
        if plan.keep is not None:
            removed = f', first {plan.keep:.0%} of the map kept'
    summary = {
        'set': name,
        'title': data_set.title + removed,
        'method': method.name.label,
        'protocol_version': VERSION,
        'images': {
            'query': material.query.sha256,
            'reference': None if data_set.online else material.reference.sha256,
        },
        'truth': hashlib.sha256(np.packbits(outcome.right).tobytes()).hexdigest(),
        'references': outcome.right.shape[1],
        'unmissable': material.unmissable,
        **summarize(outcome, verdicts, plan.criterion),
        'configuration': {
            'kind': method.name.kind,
            'options': dict(method.name.options),
            **flatten(method.config),
        },
        **provenance(),
        'argv': list(plan.argv),
        **threshold_figures(verdicts, outcome.halves),
    }
    return Result(summary, outcome, verdicts, verdicts.curve(plan.criterion, answerable))
