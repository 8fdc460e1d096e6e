# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A data set: a query, a reference and the ground truth, read from a small YAML file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
import re

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError
from convseq_ros.io.files import make_record, read_yaml
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street

READY_MADE = Path(__file__).resolve().parents[1] / 'data_sets'
# Kinds of truth, with the fields that each uses.
TRUTH_KINDS = {
    'identity': ('tolerance',),
    'table': ('path', 'tolerance', 'first_index'),
    'poses': ('path', 'radius_m'),
    'none': (),
}


@dataclass(frozen=True, slots=True)
class SimulatedDrive(Drive):
    """Images that are drawn when they are first read, identical every time."""

    street: int = 0  # seed of the street, which is as long as the drive

    def __post_init__(self) -> None:
        Drive.__post_init__(self)
        Street(1.0, self.street)

    def __iter__(self) -> Iterator[Frame]:
        return iter(_drawn(self))


@lru_cache(maxsize=2)
def _drawn(drive: SimulatedDrive) -> tuple[Frame, ...]:
    """Return all frames; they are cached, because every method reads the drive again."""
    furthest_m = max(drive.start_m, drive.distance_m(drive.num_frames))
    street = Street(furthest_m + 1.0, drive.street)
    return tuple(shot.frame for shot in draw(street, drive))


@dataclass(frozen=True, slots=True)
class Part:
    """The location of a drive's images."""

    path: Path = Path()  # folder, recording or video
    topic: str = ''  # image topic of a recording
    odom: str = ''  # odometry topic of a recording, for a truth of kind `poses`
    count: int = 0  # required number of images; 0 for any number
    simulated: SimulatedDrive | None = None  # drawn images, instead of a path
    backwards: bool = False  # last image first, at a constant frame interval

    def __post_init__(self) -> None:
        if (self.path != Path()) == (self.simulated is not None):
            raise ConfigError('needs the path of its images, or simulated, and not both')
        if len(self.topic.split()) > 1:
            raise ConfigError(
                f'topic: {self.topic!r} names several cameras, and a data set has one; make a set '
                'for each, or recognise with all of them by convseq replay'
            )

    def __str__(self) -> str:
        return 'drawn' if self.simulated else str(self.path)


@dataclass(frozen=True, slots=True)
class TruthSource:
    """The source of the ground truth, and its tolerance."""

    kind: str = ''  # one of `TRUTH_KINDS`; `none`: no place is seen twice
    path: Path | None = None
    tolerance: int = 0  # frames
    radius_m: float = 0.0  # for poses
    first_index: int = 0  # number of the first image in a table

    def __post_init__(self) -> None:
        if self.kind not in TRUTH_KINDS:
            raise ConfigError(f'kind {self.kind!r} is not one of {", ".join(TRUTH_KINDS)}')
        for item in fields(self)[1:]:
            used = item.name in TRUTH_KINDS[self.kind]
            if not used and getattr(self, item.name) != item.default:
                raise ConfigError(f'{self.kind} has no {item.name}; leave it out')
        if min(self.tolerance, self.radius_m, self.first_index) < 0:
            raise ConfigError('tolerance, radius_m and first_index must not be negative')
        if self.kind == 'table' and self.path is None:
            raise ConfigError('table has no path; add its file')
        if self.kind == 'poses' and not self.radius_m:
            raise ConfigError('poses has no radius_m; add how many metres are right')


@dataclass(frozen=True, slots=True)
class DataSet:
    """The content of a data set's YAML file."""

    name: str  # for tables and folders
    query: Part
    truth: TruthSource
    reference: Part | None = None  # None: the query is matched against its own past
    exclude_recent: int = 20  # online: latest frames that are not matched
    published: Mapping[str, Path] = field(default_factory=dict)  # scores (Q, R) of other methods
    title: str = ''
    where: str = ''  # hint where to put the images
    source: str = ''  # origin of the images

    def __post_init__(self) -> None:
        for name in (self.name, *self.published):
            if not re.fullmatch(r'\w[\w.-]*', name):
                raise ConfigError(f'name {name!r} is no folder name; use letters, digits, . _ -')
        if self.exclude_recent < 0:
            raise ConfigError(f'exclude_recent is {self.exclude_recent}; give at least 0')
        if self.online and self.truth.kind == 'identity':
            raise ConfigError(
                'truth identity needs a reference; against its own past every frame would be its '
                'own answer; give a table, poses or none'
            )

    @property
    def online(self) -> bool:
        """Whether the query is matched against its own past."""
        return self.reference is None

    @property
    def past_data_sets(self) -> 'list[DataSet]':
        """A data set per drive and direction, against its own past; no place is revisited."""
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
    """Return the set of a YAML file, or a ready-made one by name; ConfigError if there is none."""
    path = Path(text)
    if path.suffix.lower() in ('.yaml', '.yml'):
        return read_data_set(path, path.parent, reading)
    if text in ready_made():
        return read_data_set(READY_MADE / f'{text}.yaml', data_root, reading)
    raise ConfigError(f'{text}: no data set; give a YAML file or one of {", ".join(ready_made())}')


def read_data_set(path: Path, base: Path, reading: ReadingConfig = ReadingConfig()) -> DataSet:
    """Return the data set of a YAML file; relative paths start at `base`."""
    content = {'name': path.stem, **read_yaml(path, reading)}
    return make_record(DataSet, {'title': content['name'], **content}, str(path), base)
