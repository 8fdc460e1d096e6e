# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Studies: one table of what a parameter, or a change of the query, does to the figures."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from convseq_ros.config import Config, core_parameters, flatten
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.changes import check_change, pace, PACES, picture_change
from convseq_ros.evaluation.data_set import DataSet, open_data_set, READY_MADE, refuse_unknown
from convseq_ros.evaluation.material import Material, open_material
from convseq_ros.evaluation.method_name import parse_method
from convseq_ros.evaluation.methods import make_method
from convseq_ros.evaluation.protocols import closed, online
from convseq_ros.evaluation.provenance import provenance
from convseq_ros.evaluation.recognition import with_known
from convseq_ros.evaluation.run_folder import write_json, write_table
from convseq_ros.evaluation.scorecard import figures, judge
from convseq_ros.evaluation.truth import Truth
from convseq_ros.files import read_yaml
from convseq_ros.parameter import refuse_unknown as refuse_unknown_parameters
from convseq_ros.parameter import Value
from convseq_ros.reading_config import ReadingConfig
import numpy as np

STUDIES = READY_MADE / 'studies'
UNCHANGED = ('', 0.0)

Each = Callable[[Callable[[Any], dict[str, Any]], Sequence[Any]], Iterable[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class Study:
    """
    What a study file says.

    Parameters
    ----------
    name : str
        Name of its table.
    data_sets : tuple of DataSet
        What to measure on.
    methods : tuple of str
        As on the command line.
    vary : mapping of str to tuple
        Core parameters and their values; all combinations are measured.
    change : mapping of str to tuple of float
        Changes of the query and their amounts, one at a time (see `changes`).

    """

    name: str
    data_sets: tuple[DataSet, ...]
    methods: tuple[str, ...]
    vary: Mapping[str, tuple[Value, ...]]
    change: Mapping[str, tuple[float, ...]]


def ready_made_studies() -> list[str]:
    """Return the names of the studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob('*.yaml'))


def read_study(path: Path, data_root: Path, reading: ReadingConfig = ReadingConfig()) -> Study:
    """
    Return what a study file, or a ready-made study of that name, says.

    Raises
    ------
    ConfigError
        If it cannot be read or says something that cannot be understood.

    """
    if str(path) in ready_made_studies():
        path = STUDIES / f'{path}.yaml'
    elif not path.suffix:
        raise ConfigError(
            f'{path}: no study; give a YAML file or one of {", ".join(ready_made_studies())}'
        )
    said = read_yaml(path, reading)
    refuse_unknown(said, ('name', 'sets', 'methods', 'vary', 'change'), path)
    sets = _texts(said.get('sets', []), path, 'sets')
    if not sets:
        raise ConfigError(f'{path}: says no sets; add at least one')
    vary, change = (_lists(said.get(name, {}), path, name) for name in ('vary', 'change'))
    core = {item.name: item for item in core_parameters(constants=True)}
    refuse_unknown_parameters(vary, core)
    for kind, amounts in change.items():
        for amount in amounts:
            if not isinstance(amount, int | float) or isinstance(amount, bool):
                raise ConfigError(f'{path}: change {kind}: {amount!r} is not a number')
            check_change(kind, amount)
    return Study(
        str(said.get('name', path.stem)),
        tuple(_data_set(text, path, data_root, reading) for text in sets),
        tuple(_texts(said.get('methods', ['convseq']), path, 'methods')),
        {name: tuple(map(core[name].check, values)) for name, values in vary.items()},
        {kind: tuple(map(float, amounts)) for kind, amounts in change.items()},
    )


def run_study(
    study: Study,
    config: Config,
    output: Path,
    cache: Cache,
    argv: tuple[str, ...] = (),
    report: Callable[[str], None] = lambda _: None,
    each: Each = map,
) -> list[dict[str, Any]]:
    """
    Measure, and write DIR/<study>.csv and DIR/<study>.json.

    `each` measures pieces, which are independent, and returns what comes of each, in their order.

    Returns
    -------
    list of dict
        The rows of the table.

    """
    pieces = [
        _Piece(data_set, change, dict(zip(study.vary, values, strict=True)), text)
        for data_set in study.data_sets
        for change in _changes(study)
        for values in product(*study.vary.values())
        for text in study.methods
    ]
    rows = [*each(_Measuring(config, cache, report), pieces)]
    columns = dict.fromkeys(name for row in rows for name in row)
    rows = [{name: row.get(name) for name in columns} for row in rows]
    write_table(output / f'{study.name}.csv', columns, rows)
    write_json(
        output / f'{study.name}.json',
        {
            'study': study.name,
            'methods': list(study.methods),
            'configuration': flatten(config),
            **provenance(),
            'argv': list(argv),
            'rows': rows,
        },
    )
    return rows


@dataclass(frozen=True, slots=True)
class _Piece:
    """What makes one row."""

    data_set: DataSet
    change: tuple[str, float]
    chosen: Mapping[str, Value]
    method: str


class _Measuring:
    """Measures pieces; reads, and changes, images once for those that follow each other."""

    def __init__(self, config: Config, cache: Cache, report: Callable[[str], None]) -> None:
        self._config, self._cache, self._report = config, cache, report
        self._whole: Material | None = None
        self._changed: tuple[tuple[str, float], Material] | None = None

    def __call__(self, piece: _Piece) -> dict[str, Any]:
        data_set, (kind, amount) = piece.data_set, piece.change
        if self._whole is None or self._whole.data_set is not data_set:
            self._report(f'{data_set.name}: reading images')
            encoding, reading = self._config.encoding, self._config.reading
            self._whole = open_material(data_set, self._cache, encoding, reading)
            self._changed = None
        if self._changed is None or self._changed[0] != piece.change:
            changed = _with_change(self._whole, kind, amount) if kind else self._whole
            self._changed = piece.change, changed
        material, shown = self._changed[1], {**piece.chosen}
        if kind:
            shown |= {'change': kind, 'amount': amount}
        self._report(f'{data_set.name}: {piece.method} {shown}')
        settings = with_known(self._config, piece.chosen)
        return {
            'set': data_set.name,
            'method': parse_method(piece.method).label,
            **shown,
            **_figures(material, piece.method, settings, piece.chosen),
        }


def _changes(study: Study) -> list[tuple[str, float]]:
    changes = [(kind, amount) for kind, amounts in study.change.items() for amount in amounts]
    return changes if study.change else [UNCHANGED]


def _with_change(whole: Material, kind: str, amount: float) -> Material:
    truth = whole.truth
    if whole.data_set.online:
        raise ConfigError(
            f'{whole.data_set.name}: a change of the query needs a reference; choose another set'
        )
    if kind in PACES:
        new = pace(kind, amount, len(truth.right))
        query = replace(whole.query, order=new.order, restamp=new.restamp)
        truth = Truth(truth.right[np.array(new.order)], truth.tolerance)
    else:
        made_by = [kind, amount]
        query = replace(whole.query, change=picture_change(kind, amount), changed_by=made_by)
    return Material(whole.data_set, query, whole.reference, truth, whole.cache)


def _figures(
    material: Material, text: str, config: Config, chosen: Mapping[str, Value]
) -> dict[str, Any]:
    method = make_method(parse_method(text), config)
    method = replace(method, config=with_known(method.config, chosen))
    if material.data_set.online:
        outcome = online(material, method)
    else:
        outcome = closed(material, method, afresh=False)
    verdicts = judge(outcome)
    lengths = verdicts.lengths[verdicts.lengths > 0]
    values, counts = np.unique(lengths, return_counts=True)
    return {
        'queries': len(verdicts.matched),
        'matched': int(verdicts.matched.sum()),
        **figures(verdicts, 'score'),
        'mean_k': float(lengths.mean()) if len(lengths) else None,
        'min_k': int(lengths.min()) if len(lengths) else None,
        'max_k': int(lengths.max()) if len(lengths) else None,
        'k_distribution': ' '.join(
            f'{value}:{count}' for value, count in zip(values, counts, strict=True)
        ),
    }


def _data_set(text: str, path: Path, data_root: Path, reading: ReadingConfig) -> DataSet:
    beside = path.parent / text
    known = str(beside) if beside.suffix and beside.exists() else text
    return open_data_set(known, data_root, reading)


def _texts(said: Any, path: Path, name: str) -> list[str]:
    if not isinstance(said, list) or not all(isinstance(item, str) for item in said):
        raise ConfigError(f'{path}: {name} is not a list of names')
    return said


def _lists(said: Any, path: Path, name: str) -> dict[str, list[Any]]:
    fitting = isinstance(said, Mapping) and all(
        isinstance(values, list) and values for values in said.values()
    )
    if not fitting:
        raise ConfigError(f'{path}: {name} is not `name: [value, ...]`')
    return dict(said)
