# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The answers of the recogniser to the query of a data set, as `convseq replay` gives them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
import time

from convseq_ros.config import Config, flatten, with_values
from convseq_ros.config.parameter import Value
from convseq_ros.core import types
from convseq_ros.core.decision.decider import candidate
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.evaluation.material import Material
from convseq_ros.models.onnx_model import open_model
import numpy as np
import numpy.typing as npt

Scores = npt.NDArray[np.float32]  # (Q, R), pair scores; NaN where a pair was not scored
Span = tuple[int, int]  # first reference, and the one after the last
After = Callable[[PlaceRecognizer, types.Match], types.Match]
_VERIFIED = 10  # places, the best by their pair scores


@dataclass(frozen=True, slots=True)
class QueryAnswers:
    """The recogniser's answers to the Q frames of a query."""

    matches: list[types.Match]  # references are numbered as in the full drive
    durations_ms: list[float]  # time of each `process`
    rows: Scores


def overridden(config: Config, values: Mapping[str, Value]) -> Config:
    """Return a configuration with new values; names unknown to this version are ignored."""
    flat = flatten(config)
    return with_values(config, {name: value for name, value in values.items() if name in flat})


def part_of(source: ReferenceMap, first: int, last: int) -> ReferenceMap:
    """Return a map of a drive's references from `first` up to, not including, `last`."""
    (drive,) = slices_of(Path(), source)
    return joined([replace(drive, places=range(first, last))])


def alone(recognizer: PlaceRecognizer, match: types.Match) -> types.Match:
    """Return the match; the next image knows nothing of the drive."""
    recognizer.matcher.reset()
    return match


def verified(recognizer: PlaceRecognizer, match: types.Match) -> types.Match:
    """
    Return a match with its 10 best places by pair score and verification: two-stage retrieval.

    Both count alike, in standard deviations over the 10.
    """
    row, places = recognizer.pair_scores, recognizer.reference_map.places
    if match.candidates and row is not None and (features := recognizer.features):
        scores = np.nan_to_num(row)
        best = np.argsort(-scores, kind='stable')[:_VERIFIED]
        found = recognizer.matcher.verified(features, best.tolist())
        roots = np.sqrt([found[index].strength for index in best.tolist()])
        total = sum((one - one.mean()) / max(one.std(), 1e-9) for one in (scores[best], roots))
        order = np.argsort(-total, kind='stable')
        ordered = [candidate(places, int(best[at]), float(total[at])) for at in order]
        match = replace(match, candidates=tuple(ordered))
    return alone(recognizer, match)


def recognize(
    material: Material, config: Config, span: Span | None = None, after: After | None = None
) -> QueryAnswers:
    """
    Return the recogniser's answers; a drive against its own past runs in online mode.

    Without a span, images are read and described as on a robot. With a span, the map has only
    these references, and the cached descriptors are used. The answers are the same. `after`
    changes the answer to each frame, or what is remembered of it.
    """
    online = material.data_set.online
    config = overridden(config, {'mode': 'online' if online else 'preloaded'})
    model = open_model(config)
    query, reference = material.drives(config.encoding)
    reference_map = reference.reference_map
    config = replace(config, encoding=reference.encoding)
    if config.online.grows:
        reference_map = ReferenceMap(config.encoding, keyframes=config.keyframes)
    elif span:
        reference_map = part_of(reference_map, *span)
    recognizer = PlaceRecognizer(reference_map, config, describe=model)
    recognizer.matcher.warm_up()
    # A map that grows holds the first frame of each time; any other holds all of the span.
    by_time = {stamp_ns: at for at, stamp_ns in reversed([*enumerate(reference.stamps_ns)])}
    first = span[0] if span else 0

    def number(index: int, stamp_ns: int) -> int:
        return by_time[stamp_ns] if online else first + index

    frames: Iterable[tuple[types.Frame, types.Descriptor | None]]
    frames = query.described if span else ((image, None) for image in material.query)
    matches, durations = [], []
    rows = np.full((len(query), len(reference)), np.nan, np.float32)
    for row, (frame, descriptor) in zip(rows, frames, strict=True):
        started = time.perf_counter()
        match = recognizer.process(frame, descriptor)
        match = after(recognizer, match) if after else match
        durations.append((time.perf_counter() - started) * 1e3)
        newest = None if match.reason is types.Reason.OUT_OF_ORDER else recognizer.pair_scores
        if newest is not None:
            usable = enumerate(reference_map.places[: len(newest)])
            row[[number(index, place.stamp_ns) for index, place in usable]] = newest
        matches.append(
            renumbered(match, lambda best: number(best.reference_index, best.reference_stamp_ns))
        )
    return QueryAnswers(matches, durations, rows)


def renumbered(match: types.Match, number: Callable[[types.Candidate], int]) -> types.Match:
    """Return a match whose references are renumbered by `number`."""
    candidates = tuple(replace(best, reference_index=number(best)) for best in match.candidates)
    return replace(match, candidates=candidates)
