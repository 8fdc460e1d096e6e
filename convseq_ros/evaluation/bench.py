# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Methods on data sets: everything that `convseq evaluate` does, as one function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from convseq_ros.config import Config, flatten
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation import protocols
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.comparison import calibrate, compare_times, Result, Summary, transfer
from convseq_ros.evaluation.data_set import DataSet
from convseq_ros.evaluation.material import Material, open_material, with_distractors
from convseq_ros.evaluation.method_name import MethodName, parse_method
from convseq_ros.evaluation.methods import make_method, Method
from convseq_ros.evaluation.protocols import CLOSED, ONLINE, OPEN, Outcome
from convseq_ros.evaluation.provenance import provenance
from convseq_ros.evaluation.run_folder import (
    write_curve,
    write_fields,
    write_frames,
    write_json,
    write_poses,
    write_scores,
    write_summary_table,
    write_truth,
)
from convseq_ros.evaluation.scorecard import judge, summarize, Verdicts
from convseq_ros.evaluation.thumbnails import write_thumbnails
from convseq_ros.evaluation.transfer import Measured

DEFAULT_METHODS = ('convseq', 'convseq-k10', 'convseq-forward', 'cohog', 'seqslam', 'hog')
PUBLISHED = 'published'
PAST = 'past'


@dataclass(frozen=True, slots=True)
class Plan:
    """
    What to run.

    Parameters
    ----------
    methods : tuple of str
        As on the command line; `published` stands for a set's own score matrices.
    protocols : tuple of str
        closed, open and past, for sets with a reference; past: each of its drives against its
        own past, forwards and backwards, where nothing is revisited.
    criterion : str
        What the curves are drawn over: score, margin or confidence.
    transfer : bool
        Whether to try thresholds from the other sets.
    exclude_recent : int or None
        Overrides what the sets say, for drives against their own past.
    keep : float or None
        Share of the map, from its start, that the open protocol keeps; otherwise halves of it.
    distractors : int
        Drawn places that no query shows, added to every map.
    argv : tuple of str
        The command, for the record.

    """

    methods: tuple[str, ...] = DEFAULT_METHODS
    protocols: tuple[str, ...] = (CLOSED,)
    criterion: str = 'score'
    transfer: bool = False
    exclude_recent: int | None = None
    keep: float | None = None
    distractors: int = 0
    argv: tuple[str, ...] = ()


def evaluate(
    data_sets: Sequence[DataSet],
    config: Config,
    plan: Plan,
    output: Path,
    cache: Cache,
    report: Callable[[str], None] = lambda _: None,
) -> list[Summary]:
    """
    Run every method on every set and write the run folder.

    Parameters
    ----------
    data_sets : sequence of DataSet
        What to run on; names must differ.
    config : Config
        The core's parameters, for all methods that do not bring their own.
    plan : Plan
        What to run.
    output : Path
        The run folder (see `run_folder`).
    cache : Cache
        Where encodings and results are kept.
    report : callable
        Told what is being done.

    Returns
    -------
    list of dict
        The summaries, in order.

    Raises
    ------
    ConvseqError
        If a set, a method or an option is wrong.

    """
    names = [data_set.name for data_set in data_sets]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f'{name}: two data sets of this name; rename one')
    results: list[Result] = []
    for data_set in data_sets:
        results += _on_set(data_set, config, plan, output, cache, report)
    for result in results:
        calibrate(result, results)
        if plan.transfer:
            transfer(result, results, plan.criterion)
    for result in results:
        write_json(result.folder / 'summary.json', result.summary)
    summaries = [result.summary for result in results]
    write_summary_table(output, summaries)
    return summaries


def method_names(texts: Sequence[str], data_set: DataSet) -> list[MethodName]:
    """
    Return the methods to run on a set, `published` spelt out.

    Raises
    ------
    ConfigError
        If one cannot be understood, or two have the same label.

    """
    names = []
    for text in texts:
        if text == PUBLISHED:
            for label, path in data_set.published.items():
                for suffix, length in (('', 1), ('-k10', 10), ('-dynamic', 0)):
                    names.append(MethodName(label + suffix, 'scores', str(path), length))
        else:
            names.append(parse_method(text))
    labels = [name.label for name in names]
    for label in labels:
        if labels.count(label) > 1:
            raise ConfigError(f'{label}: two methods of this label; write another one before =')
    return names


def _on_set(
    data_set: DataSet,
    config: Config,
    plan: Plan,
    output: Path,
    cache: Cache,
    report: Callable[[str], None],
) -> list[Result]:
    if plan.exclude_recent is not None:
        data_set = replace(data_set, exclude_recent=plan.exclude_recent)
    results: list[Result] = []
    if PAST in plan.protocols and not data_set.online:
        for past in data_set.own_pasts:
            results += _on_set(past, config, plan, output, cache, report)
        plan = replace(plan, protocols=tuple(one for one in plan.protocols if one != PAST))
        if not plan.protocols:
            return results
    methods = [make_method(name, config) for name in method_names(plan.methods, data_set)]
    report(f'{data_set.name}: reading images')
    material = open_material(data_set, cache, config.encoding, config.reading)
    if plan.distractors and not data_set.online:
        material = with_distractors(material, plan.distractors)
    base = output / data_set.name
    write_truth(base, material.truth)
    query, reference = material.drives(config.encoding)
    write_poses(base, query.poses, reference.poses)
    write_thumbnails(base / 'thumbnails' / 'query', material.query)
    if not data_set.online:
        write_thumbnails(base / 'thumbnails' / 'reference', material.reference)
    for protocol in (ONLINE,) if data_set.online else plan.protocols:
        name = f'{data_set.name}-open' if protocol == OPEN else data_set.name
        _describe_set(output / name, name, protocol, material, plan.keep)
        if protocol == OPEN and CLOSED not in plan.protocols:
            _describe_set(base, data_set.name, CLOSED, material)
        found = []
        for method in methods:
            report(f'{name}: {method.name.label}')
            found.append(_measure(material, method, protocol, output / name, plan))
        compare_times([result.summary for result in found])
        results += found
    return results


def _measure(
    material: Material, method: Method, protocol: str, folder: Path, plan: Plan
) -> Result:
    ask: dict[str, Callable[[Material, Method], Outcome]] = {
        CLOSED: protocols.closed,
        OPEN: partial(protocols.open_set, keep=plan.keep),
        ONLINE: protocols.online,
    }
    outcome = ask[protocol](material, method)
    verdicts = judge(outcome)
    own = folder / method.name.label
    own.mkdir(parents=True, exist_ok=True)
    write_frames(own / 'frames.csv', outcome, verdicts)
    write_fields(own / 'fields.npz', outcome.fields)
    if protocol != OPEN:
        write_scores(own / 'scores.npy', outcome)
    write_curve(own / 'curve.csv', _known_curve(verdicts, plan.criterion))
    summary = {
        'set': folder.name,
        'method': method.name.label,
        **summarize(outcome, verdicts, plan.criterion),
        'configuration': {
            'kind': method.name.kind,
            'argument': method.name.argument,
            'options': dict(method.name.options),
            **flatten(method.config),
        },
        **provenance(),
        'argv': list(plan.argv),
    }
    data_set = material.data_set
    return Result(own, summary, Measured(folder.name, data_set.place or data_set.name, verdicts))


def _known_curve(verdicts: Verdicts, criterion: str) -> Any:
    return verdicts.curve(criterion, int((verdicts.matched & verdicts.known).sum()))


def _describe_set(
    folder: Path, name: str, protocol: str, material: Material, keep: float | None = None
) -> None:
    data_set, removed = material.data_set, ''
    if protocol == OPEN:
        kept = '' if keep is None else f', first {keep:.0%} of the map kept'
        removed = kept or ', half of the map removed'
    queries, references = material.truth.right.shape
    write_json(
        folder / 'set.json',
        {
            'name': name,
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
        },
    )
