# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser once more over a drive whose images are described already."""

from collections.abc import Iterator

from convseq_ros.config import Config
from convseq_ros.core.map.edit import carry_links
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
from convseq_ros.evaluation.drive import Drive
from convseq_ros.evaluation.geometry import Dots, Geometry


def part_of(whole: ReferenceMap, first: int, last: int, step: int = 1) -> ReferenceMap:
    """Return a map of the references from `first` to before `last`, in steps, and their links."""
    part = ReferenceMap(whole.encoding, keyframes=whole.keyframes, sessions=whole.sessions)
    for index in range(first, last, step):
        part.add(whole.places[index], whole.packed(index))
    carry_links([(whole, index) for index in range(first, last, step)], part.links)
    return part


def rerun(
    drive: Drive,
    reference_map: ReferenceMap,
    config: Config,
    posed_map: ReferenceMap | None = None,
) -> Iterator[tuple[Match, Dots]]:
    """
    Yield the answer to every frame of a drive, and its inliers.

    Parameters
    ----------
    drive : Drive
        The query.
    reference_map : ReferenceMap
        The references, or a part of them.
    config : Config
        Its encoding is that of the drive.
    posed_map : ReferenceMap, optional
        The same references with poses, for relative poses.

    """
    recognizer = PlaceRecognizer(reference_map, config)
    geometry = Geometry(recognizer, posed_map)
    for stamp_ns, readable, descriptor in zip(
        drive.stamps_ns, drive.readable, drive.descriptors, strict=True
    ):
        match = recognizer.process(Frame(stamp_ns, None), descriptor if readable else None)
        yield geometry.add(match, Frame(stamp_ns, None, camera=drive.camera))
