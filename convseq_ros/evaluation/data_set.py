# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A data set: a query, a reference and a truth, named by a small YAML file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
import re
from typing import Any

from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.simulated import read_simulated, SimulatedDrive
from convseq_ros.files import read_yaml
from convseq_ros.parameter import refuse_unknown
from convseq_ros.reading_config import ReadingConfig

READY_MADE = Path(__file__).resolve().parents[1] / 'data_sets'
_MOST = 2**31 - 1  # of any number: frames or metres
TRUTH_KINDS = ('identity', 'table', 'poses', 'none')


@dataclass(frozen=True, slots=True)
class Part:
    """Where the images of a drive are."""

    path: Path = Path()  # folder, recording or video
    topic: str = ''  # of a recording: its images
    odom: str = ''  # of a recording: the poses that a truth of kind `poses` takes
    count: int = 0  # images that must be there; 0 for any number
    simulated: SimulatedDrive | None = None  # images that are drawn; there is no path then
    backwards: bool = False  # the last image comes first

    def __str__(self) -> str:
        return 'drawn' if self.simulated else str(self.path)


@dataclass(frozen=True, slots=True)
class TruthSource:
    """Where the truth is, and how far off an answer may be."""

    kind: str  # one of `TRUTH_KINDS`; `none` says that no place is seen twice
    path: Path | None = None
    tolerance: int = 0  # frames
    radius_m: float = 0.0  # for poses
    first_index: int = 0  # the number that a table gives to the first image


@dataclass(frozen=True, slots=True)
class DataSet:
    """What a YAML file says."""

    name: str  # in tables and folders
    query: Part
    truth: TruthSource
    reference: Part | None = None  # None: the query is matched against its own past
    exclude_recent: int = 20  # latest frames that are no loop closure, against its own past
    published: Mapping[str, Path] = field(default_factory=dict)  # scores (Q, R) of other methods
    title: str = ''
    where: str = ''  # where the images belong, for people
    source: str = ''  # where they come from

    @property
    def online(self) -> bool:
        """Whether the query is matched against its own past."""
        return self.reference is None

    @property
    def own_pasts(self) -> 'list[DataSet]':
        """Its drives, each against its own past, forwards and backwards: nothing is revisited."""
        drives = {'query': self.query, 'reference': self.reference}
        return [
            DataSet(
                f'{self.name}-{label}-{"backwards" if backwards else "forwards"}',
                replace(part, backwards=part.backwards != backwards),
                TruthSource('none'),
                exclude_recent=self.exclude_recent,
                title=f'{self.title}: {label} against its own past{", backwards" * backwards}',
                where=self.where,
                source=self.source,
            )
            for label, part in drives.items()
            if part is not None
            for backwards in (False, True)
        ]


def ready_made() -> list[str]:
    """Return the names of the data sets that come with the package."""
    return sorted(path.stem for path in READY_MADE.glob('*.yaml'))


def open_data_set(
    text: str, data_root: Path = Path(), reading: ReadingConfig = ReadingConfig()
) -> DataSet:
    """
    Return the data set that a user names; ConfigError if there is none, or it makes no sense.

    `text` is a YAML file, whose relative paths start at the file, or the name of a ready-made set,
    whose relative paths start at `data_root`.
    """
    path = Path(text)
    if path.suffix.lower() in ('.yaml', '.yml'):
        return read_data_set(path, path.parent, reading)
    if text in ready_made():
        return read_data_set(READY_MADE / f'{text}.yaml', data_root, reading)
    raise ConfigError(f'{text}: no data set; give a YAML file or one of {", ".join(ready_made())}')


def read_data_set(path: Path, base: Path, reading: ReadingConfig = ReadingConfig()) -> DataSet:
    """Return what a YAML file says, its relative paths starting at `base`."""
    content = _mapping(read_yaml(path, reading), path, 'the file', DataSet)
    name = str(content.get('name', path.stem))
    if not re.fullmatch(r'[\w.-]+', name) or name.startswith('.'):
        raise ConfigError(f'{path}: name {name!r} is no folder name; use letters, digits, . _ -')
    for needed in ('query', 'truth'):
        if needed not in content:
            raise ConfigError(f'{path}: says no {needed}; add it')
    reference = content.get('reference')
    published = {
        str(label): base / str(file)
        for label, file in _mapping(content.get('published', {}), path, 'published').items()
    }
    data_set = DataSet(
        name=name,
        query=_part(content['query'], path, base, 'query'),
        reference=None if reference is None else _part(reference, path, base, 'reference'),
        truth=_truth(content['truth'], path, base),
        exclude_recent=_number(content.get('exclude_recent', 20), int, path, 'exclude_recent'),
        published=published,
        title=str(content.get('title', name)),
        where=' '.join(str(content.get('where', '')).split()),
        source=' '.join(str(content.get('source', '')).split()),
    )
    if data_set.online and data_set.truth.kind == 'identity':
        raise ConfigError(
            f'{path}: truth identity needs a reference; against its own past every frame would '
            'be its own answer; give a table, poses or none'
        )
    return data_set


def _part(content: Any, path: Path, base: Path, name: str) -> Part:
    said = _mapping(content, path, name, Part)
    drawn = said.get('simulated')
    if ('path' in said) == (drawn is not None):
        raise ConfigError(f'{path}: {name} has no path; add where its images are, or simulated')
    backwards = said.get('backwards', False)
    if not isinstance(backwards, bool):
        raise ConfigError(f'{path}: {name}: backwards: {backwards!r} is not true or false')
    topic = str(said.get('topic', ''))
    if len(topic.split()) > 1:
        raise ConfigError(
            f'{path}: {name}: topic: {topic!r} names several cameras, and a data set has one; '
            'make a set for each, or recognise with all of them by convseq replay'
        )
    return Part(
        base / str(said['path']) if drawn is None else Path(),
        topic,
        str(said.get('odom', '')),
        _number(said.get('count', 0), int, path, f'{name}: count'),
        None if drawn is None else read_simulated(_mapping(drawn, path, name), path),
        backwards,
    )


def _truth(content: Any, path: Path, base: Path) -> TruthSource:
    said = _mapping(content, path, 'truth', TruthSource)
    kind = str(said.get('kind', ''))
    if kind not in TRUTH_KINDS:
        raise ConfigError(f'{path}: truth kind {kind!r} is not one of {", ".join(TRUTH_KINDS)}')
    if kind == 'table' and 'path' not in said:
        raise ConfigError(f'{path}: truth table has no path; add its file')
    radius_m = _number(said.get('radius_m', 0), float, path, 'radius_m')
    if kind == 'poses' and not radius_m:
        raise ConfigError(f'{path}: truth poses has no radius_m; add how many metres are right')
    return TruthSource(
        kind,
        base / str(said['path']) if 'path' in said else None,
        _number(said.get('tolerance', 0), int, path, 'tolerance'),
        radius_m,
        _number(said.get('first_index', 0), int, path, 'first_index'),
    )


def _mapping(content: Any, path: Path, what: str, record: Any = None) -> Mapping[str, Any]:
    """Return a mapping whose keys are fields of a record, if there is one; else ConfigError."""
    if not isinstance(content, Mapping):
        raise ConfigError(f'{path}: {what} is not a list of `key: value`')
    if record:
        refuse_unknown(content, [item.name for item in fields(record)], f'{path}: unknown key')
    return content


def _number(value: Any, kind: Any, path: Path, name: str) -> Any:
    fitting = isinstance(value, int | float) and not isinstance(value, bool)
    if not fitting or not 0 <= value <= _MOST or kind(value) != value:
        raise ConfigError(f'{path}: {name}: {value!r} is not a number of the right kind')
    return kind(value)
