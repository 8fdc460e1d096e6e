# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The right references of each query: from tables of pairs, positions, or equal indices."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass
import io
import math
from pathlib import Path, PurePath
import re

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.io.files import read_text
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]
Metres = npt.NDArray[np.float64]
SLIP_FRAMES = 3
_EQUATOR_M, _ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3  # of the ellipsoid WGS 84
_NAMES = 'image', 'filename', 'name'  # columns with the name of an image
_WHOLE = re.compile(r'[0-9]+(\.0*)?')


@dataclass(frozen=True, slots=True)
class Truth:
    """The ground truth."""

    right: Flags  # (Q, R), right references; an empty row is a place that the map lacks
    tolerance: int = 0  # frames, already included in `right`

    @property
    def known(self) -> Flags:
        """Flags of the queries that have a right reference, (Q,)."""
        return np.asarray(self.right.any(axis=1))

    @property
    def slip(self) -> Flags:
        """Flags of the references up to 3 frames beyond the tolerance, (Q, R)."""
        return _widened(self.right, SLIP_FRAMES) & ~self.right


def same_index(queries: int, references: int, tolerance: int) -> Truth:
    """Return the truth of drives with equal indices; SourceError if their lengths differ."""
    if queries != references:
        raise SourceError(
            f'truth: identity needs drives of one length, got {queries} query and {references} '
            'reference images; give a table or complete the folders'
        )
    return Truth(_widened(np.eye(queries, dtype=np.bool_), tolerance), tolerance)


def from_pairs(
    pairs: Numbers, shape: tuple[int, int], tolerance: int, where: str, first_index: int = 0
) -> Truth:
    """
    Return the truth of pairs (P, 2), or (P, 3) with tolerances; SourceError out of range.

    The error counts from `first_index`, as the table does.
    """
    right = np.zeros(shape, np.bool_)
    for query, reference, *own_tolerance in pairs.tolist():
        for kind, index, count in (('query', query, shape[0]), ('reference', reference, shape[1])):
            if not 0 <= index < count:
                raise SourceError(
                    f'{where}: {kind} {index + first_index} does not exist, there are {count} '
                    f'({first_index} to {first_index + count - 1}); complete the images, or '
                    'correct the truth or its first_index'
                )
        pair_tolerance = own_tolerance[0] if own_tolerance else tolerance
        right[query, max(0, reference - pair_tolerance) : reference + pair_tolerance + 1] = True
    return Truth(right, tolerance)


def within_radius(queries: Metres, references: Metres, radius_m: float) -> Truth:
    """Return the truth of positions (Q, 3) and (R, 3) in metres; NaN is never right."""
    right = [np.linalg.norm(query - references, axis=1) <= radius_m for query in queries]
    return Truth(np.array(right, np.bool_).reshape(len(queries), len(references)))


def past_only(truth: Truth, exclude_recent: int) -> Truth:
    """Return the truth of a drive against its own past, without the latest frames."""
    return Truth(truth.right & is_past(len(truth.right), exclude_recent), truth.tolerance)


def is_past(count: int, exclude_recent: int) -> Flags:
    """Return which frames of a drive, by column, may match each one, by row: flags (Q, Q)."""
    index = np.arange(count)
    return np.asarray(index[None] <= index[:, None] - max(1, exclude_recent))


def _widened(right: Flags, frames: int) -> Flags:
    wide = right.copy()
    for offset in range(1, min(frames, right.shape[1] - 1) + 1):
        wide[:, offset:] |= right[:, :-offset]
        wide[:, :-offset] |= right[:, offset:]
    return wide


def read_pairs(
    path: Path,
    query_names: Sequence[str],
    reference_names: Sequence[str],
    first_index: int = 0,
    reading: ReadingConfig = ReadingConfig(),
) -> Numbers:
    """
    Return the 0-based pairs of a CSV table, int64 (P, 2), or (P, 3) with a tolerance each.

    The columns are query, reference and optionally `tolerance`: frame numbers from `first_index`
    on, or file names. Under other names, the first two columns are meant; a table needs no names.
    A cell may hold several references. SourceError if it cannot be read.
    """
    query_of, reference_of = (
        _numbers(names, first_index) for names in (query_names, reference_names)
    )
    reader = csv.reader(io.StringIO(read_text(path, 'a CSV table', reading), newline=''))
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error:
        raise SourceError(f'{path}: not a CSV table; check the file') from None
    first = [cell.strip() for cell in rows[0][1]] if rows else []
    names, lines = [cell.lower() for cell in first], rows[1:]
    with suppress(LookupError):
        query_of(first[0])
        names, lines = ['query', 'reference'], rows
    columns = _columns(names, path)
    pairs = []
    for line, row in lines:
        try:
            query, references, *tolerance = (row[column].strip() for column in columns)
            found = [[query_of(query), reference_of(cell)] for cell in references.split()]
            pairs += [[*pair, *map(_count, tolerance)] for pair in found]
        except (LookupError, ValueError):
            raise SourceError(
                f'{path}: line {line} ({",".join(row)[:80]}) names no frames; expected numbers or '
                'names of images'
            ) from None
        if any(row[len(names) :]):
            raise SourceError(
                f'{path}: line {line} ({",".join(row)[:80]}) has more cells than the first line; '
                'put several references into one, with spaces between'
            )
    try:
        return np.array(pairs, np.int64).reshape(-1, len(columns))
    except OverflowError:
        raise SourceError(f'{path}: a frame number is too large') from None


def _columns(names: Sequence[str], path: Path) -> list[int]:
    """Return which columns of a table are query, reference and, if there is one, tolerance."""
    kinds = 'query', 'reference'
    named = [names.index(kind) for kind in kinds if kind in names]
    tolerance = [names.index('tolerance')] if 'tolerance' in names else []
    chosen = named or [at for at in range(len(names)) if at not in tolerance][:2]
    if len(chosen) < 2:
        raise SourceError(
            f'{path}: expected a header and the columns query, reference, with commas between'
        )
    return chosen + tolerance


def read_positions(
    path: Path, drive: str, names: Sequence[str], reading: ReadingConfig = ReadingConfig()
) -> Metres:
    """
    Return the positions of a drive's images, `query` or `reference`, (N, 3), in metres.

    The CSV table has the columns x, y in metres, or lat, lon (latitude, longitude) in degrees, and
    optionally z and `drive`. Rows belong to the image that a column `image` (or filename, name)
    names; without one there is a row an image, in order. A position that is not finite is unknown,
    NaN. SourceError for another table.
    """
    text = io.StringIO(read_text(path, 'a CSV table', reading), newline='')
    table = csv.DictReader(text)
    positions, owners = list[list[float]](), list[str]()
    wanted = 'the columns x, y, z in metres, or lat, lon in degrees'
    try:
        table.fieldnames = [name.strip().lower() for name in table.fieldnames or []]
        column = next((name for name in _NAMES if name in table.fieldnames), None)
        for row in table:
            if row.get('drive', drive).strip().lower() == drive:
                if any(row.get(None, ())):  # more cells than the first line
                    raise ValueError
                positions.append(_position(row))
                owners += [PurePath(row[column].strip()).name] if column else []
    except (csv.Error, KeyError):
        raise SourceError(f'{path}: expected a CSV table with {wanted}') from None
    except (AttributeError, TypeError, ValueError):
        line = text.getvalue().splitlines()[table.line_num - 1][:80]
        raise SourceError(
            f'{path}: line {table.line_num} ({line}) tells no position; expected numbers with a '
            f'point, or nan, in {wanted}'
        ) from None
    if column:
        positions = _by_name(positions, owners, drive, names, path)
    if len(positions) != len(names):
        raise SourceError(
            f'{path}: {len(positions)} positions for {len(names)} {drive} images; give one for '
            'each, or name the images in a column image'
        )
    found = np.array(positions).reshape(-1, 3)
    return np.where(np.isfinite(found).all(axis=1, keepdims=True), found, np.nan)


def _position(row: Mapping[str, str]) -> list[float]:
    """Return x, y, z of a row, in metres; degrees count from the Earth's centre (WGS 84)."""
    height_m = float(row.get('z') or 0)
    if 'x' in row:
        return [float(row['x']), float(row['y']), height_m]
    latitude = float(row['lat'] if 'lat' in row else row['latitude'])
    longitude = math.radians(float(row['lon'] if 'lon' in row else row['longitude']))
    if abs(latitude) > 90:
        raise ValueError(latitude)
    sine, cosine = (turn(math.radians(latitude)) for turn in (math.sin, math.cos))
    radius_m = _EQUATOR_M / math.sqrt(1 - _ECCENTRICITY_2 * sine**2)
    out_m = (radius_m + height_m) * cosine
    up_m = (radius_m * (1 - _ECCENTRICITY_2) + height_m) * sine
    return [out_m * math.cos(longitude), out_m * math.sin(longitude), up_m]


def positions_in(names: Sequence[str]) -> Metres | None:
    """
    Return positions that names of images tell, (N, 3); None if one tells none.

    They have the form @EAST@NORTH@, metres of UTM, as many public data sets do.
    """
    found = [name.split('@')[:4] for name in names]
    try:
        return np.array([[float(east), float(north), 0.0] for _, east, north, _ in found])
    except ValueError:
        return None


def _by_name(
    positions: list[list[float]],
    owners: Sequence[str],
    drive: str,
    names: Sequence[str],
    path: Path,
) -> list[list[float]]:
    """Return the positions of the named images, in their order."""
    by_name = dict(zip(owners, positions, strict=True))
    if len(by_name) < len(owners):
        twice = next(name for name in owners if owners.count(name) > 1)
        raise SourceError(
            f'{path}: two rows name {twice!r}; leave one, or tell query and reference apart in a '
            'column drive'
        )
    found = [by_name.get(name, by_name.get(PurePath(name).stem)) for name in names]
    absent = [name for name, position in zip(names, found, strict=True) if position is None]
    if absent:
        raise SourceError(
            f'{path}: no row names {len(absent)} of {len(names)} {drive} images, such as '
            f'{absent[0]}; add them, with x nan where it is unknown'
        )
    return [position for position in found if position is not None]


def _numbers(names: Sequence[str], first_index: int) -> Callable[[str], int]:
    by_name = {name: index for index, name in enumerate(names)}
    by_name |= {Path(name).stem: index for index, name in enumerate(names)}

    def number(cell: str) -> int:
        # 0007 is a name, if an image has it.
        is_name = not _WHOLE.fullmatch(cell) or (cell in by_name and cell != str(_count(cell)))
        return by_name[cell] if is_name else _count(cell) - first_index

    return number


def _count(cell: str) -> int:
    """Return a whole number that is not negative, 2 for 2.0; LookupError for another cell."""
    if not _WHOLE.fullmatch(cell):
        raise LookupError(cell)
    return int(cell.partition('.')[0])
