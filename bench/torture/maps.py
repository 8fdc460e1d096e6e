# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps whose places follow from their index, and checks of these maps."""

from collections.abc import Callable
from pathlib import Path
import time

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.core.types import Pose, RelativePose
from convseq_ros.errors import MapError
import numpy as np

ENCODING, APART = EncodingConfig(image_size_px=64), KeyframeConfig()
_RELATIVE = RelativePose((0.0, 0.0, 0.0, 1.0), (1.0, 2.0, 3.0), (1.0, 0.0, 0.0), np.eye(6), 30)
_MOST_S = 5.0  # that the use of a damaged map takes


def grow(reference_map: ReferenceMap, count: int, drive: int = 0) -> None:
    """Add places whose content follows from their index."""
    for index in range(len(reference_map), len(reference_map) + count):
        pose = Pose((index, 0, 0), (0, 0, 0, 1)) if index % 2 else None
        place = Place(index, f'drive {drive}', pose)
        reference_map.add(place, cells(index, drive), b'%d' % index)
        if (other := linked_to(index)) is None:
            reference_map.links.add_first(index)
        else:
            reference_map.links.add(index, other, 0.75, index, _RELATIVE if index % 2 else None)


def linked_to(index: int) -> int | None:
    """Return the place that a place is linked to, or None."""
    return index // 2 if index % 3 else None


def cells(index: int, drive: int = 0) -> np.ndarray:
    """Return the packed cells of a place that `grow` adds."""
    return pack_cells(np.random.default_rng([index, drive]).random((4, 4, 8), np.float32) * 1e5)


def holds(path: Path, drive: int = 0) -> int:
    """Return the number of places of a map; AssertionError if a place has other content."""
    opened = open_map(path, ENCODING)
    for index, place in enumerate(opened.places):
        assert (place.stamp_ns, place.source) == (index, f'drive {drive}'), index
        assert (opened.packed(index) == cells(index, drive)).all(), index
        assert opened.thumbnail(index) == b'%d' % index, index
    # A killed program may have stored a place without its link.
    assert not opened.problem and opened.links.looked_up_count >= len(opened) - 1, len(opened)
    assert links_hold(opened)
    return len(opened)


def links_hold(reference_map: ReferenceMap) -> bool:
    """Return whether all links are those of `grow`."""
    return all(
        (link.other, link.confidence, link.inliers) == (linked_to(link.place), 0.75, link.place)
        and (link.relative is None or link.relative.position_m == _RELATIVE.position_m)
        and link.anchor <= link.other
        for link in reference_map.links.each()
    )


def answers(path: Path) -> tuple[object, ...]:
    """Return all answers of a map but its links, in a form that can be compared."""
    reader = MapReader(path)
    opened = reader.reference_map()
    pictures = opened.pictures(range(len(opened)), with_images=True)
    shown = [(one.packed.tobytes(), one.thumbnail, one.image) for one in pictures]
    vectors = opened.global_descriptors.tobytes()
    return reader.settings, opened.sessions, [*opened.places], vectors, shown


def add_one(path: Path, count: int) -> str:
    """Add a place to a map of `count` places; return the problem, or an empty text."""
    expected = drawn(count + 1)
    with MapWriter(path, ENCODING, APART, append=True) as writer:
        writer.copy(expected, count + 1)
    added = open_map(path).places[count:]
    return '' if [*added] == [*expected.places[count:]] else 'what was added is not there'


def problem_of_use(path: Path, use: Callable[[], str], may_refuse: bool = True) -> str:
    """Return the problem of using a damaged map, which may be refused, or an empty text."""
    started_s = time.monotonic()
    try:
        if problem := use():
            return problem
    except MapError as error:
        if not may_refuse or '\n' in str(error) or path.name not in str(error):
            return f'says {error}'
    except Exception as error:
        return repr(error)
    took_s = time.monotonic() - started_s
    return f'took {took_s:.1f} s' if took_s > _MOST_S else ''


def drawn(count: int, drive: int = 0) -> ReferenceMap:
    """Return a map of places that `grow` adds."""
    reference_map = ReferenceMap(ENCODING)
    grow(reference_map, count, drive)
    return reference_map


def log_of(path: Path) -> Path:
    """Return where the log of a map is."""
    return path.with_name(f'{path.name}-wal')


def crash(path: Path, *counts: int, drive: int = 0) -> list[int]:
    """
    Leave what a crash leaves of a map that grew to these counts of places, one after the other.

    All but the first are in its log alone; return the sizes of the log after each of them.
    """
    save_map(drawn(counts[0], drive), path)
    with MapWriter(path, ENCODING, APART, append=True) as writer:
        writer.write_ahead()
        sizes = []
        for count in counts[1:]:
            writer.copy(drawn(count, drive), count)
            sizes.append(log_of(path).stat().st_size)
        left = {one: one.read_bytes() for one in (path, log_of(path))}
    for one, content in left.items():
        one.write_bytes(content)
    return sizes
