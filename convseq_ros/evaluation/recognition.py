# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser itself over a data set, as `convseq replay` runs it, and its pair scores."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
import json
import time
from typing import Any

from convseq_ros.config import AcceptanceConfig, Config, flatten, SequenceConfig, with_values
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import (
    Anchor,
    Candidate,
    Localization,
    LocalizationState,
    Match,
    Reason,
    RelativePose,
    Status,
)
from convseq_ros.evaluation.geometry import Dots, Geometry
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.rerun import part_of, rerun
from convseq_ros.parameter import Value
import numpy as np
import numpy.typing as npt

Scores = npt.NDArray[np.float32]
_VECTORS = 'orientation', 'position_m', 'direction'
_SEQUENCE_ONLY = {
    item.name for group in (SequenceConfig, AcceptanceConfig) for item in fields(group)
}


@dataclass(frozen=True, slots=True)
class Recognition:
    """
    What the recogniser said.

    Parameters
    ----------
    matches : list of Q Match
        Its answers.
    durations_ms : list of Q floats
        Time of each `process`.
    rows : ndarray of float32, shape (Q, R)
        Pair scores; NaN where a pair was not scored.
    fields : list of Q uint8 arrays (n, 4)
        The inliers of each best candidate, as `Dots`.

    """

    matches: list[Match]
    durations_ms: list[float]
    rows: npt.NDArray[np.float32]
    fields: list[Dots]


def with_known(config: Config, values: Mapping[str, Value]) -> Config:
    """Return a configuration with other values; names that this version lacks are passed over."""
    flat = flatten(config)
    return with_values(config, {name: value for name, value in values.items() if name in flat})


def recognize(material: Material, config: Config) -> Recognition:
    """
    Feed every query frame to a recogniser, or recall what it said in an earlier run.

    A drive against its own past is fed to one in online mode, whose map grows; references are then
    frames of the drive, and rows are NaN where a frame was not yet past.
    """
    if material.data_set.online:
        config = _online(material, config)
    facts = [material.content, flatten(config)]
    kept = material.cache.get('recognitions', facts)
    if kept is None:
        kept = _recognized(material, config)
        material.cache.put('recognitions', facts, kept)
        pairs = {'rows': kept['rows'], 'frame_ms': np.median(kept['durations_ms'])}
        material.cache.put('rows', _pair_facts(material, config), pairs)
    matches, dots = _answers(kept)
    return Recognition(matches, kept['durations_ms'].tolist(), kept['rows'], dots)


def pair_scores(material: Material, config: Config) -> tuple[npt.NDArray[np.float32], float]:
    """
    Return the pair scores of all images, and the median time to score a row.

    Returns
    -------
    scores : ndarray of float32, shape (Q, R)
        NaN in the rows of frames that were not scored.
    frame_ms : float
        Median time of a whole frame, in milliseconds.

    Notes
    -----
    They do not depend on how sequences are formed, so one pass serves all sequence settings.

    """
    query = material.query
    reordered = query.order is not None and query.change is None
    if reordered and not material.data_set.online and not _depends_on_the_drive(config):
        rows, frame_ms = pair_scores(replace(material, query=query.whole, _drives={}), config)
        return rows[np.array(query.order)], frame_ms
    config = with_known(config, {'search': 'exhaustive'})
    if material.data_set.online:
        config = _online(material, config)
    kept = material.cache.get('rows', _pair_facts(material, config))
    if kept is None:
        found = recognize(material, config)
        return found.rows, float(np.median(found.durations_ms))
    return kept['rows'], float(kept['frame_ms'])


def answer_again(
    material: Material, config: Config, first: int, last: int
) -> tuple[list[Match], list[Dots]]:
    """
    Return what the recogniser says when only a part of the map is there, and the inliers.

    Parameters
    ----------
    material : Material
        The data set.
    config : Config
        The parameters.
    first, last : int
        The references from `first` to before `last` are the map; answers count from its start.

    """
    facts = [material.content, flatten(config), first, last]
    kept = material.cache.get('answers', facts)
    if kept is None:
        query, reference = material.drives(config.encoding)
        posed = reference.posed_map
        whole = (reference.reference_map, *([posed] if posed else []))
        part, *of_poses = (part_of(one, first, last) for one in whole)
        kept = _kept(rerun(query, part, config, *of_poses))
        material.cache.put('answers', facts, kept)
    return _answers(kept)


def past_only(scores: Scores, past: int) -> Scores:
    """Return scores (Q, Q) of a drive with itself, NaN where a frame is not long past."""
    index = np.arange(len(scores))
    return np.where(index[None] <= index[:, None] - past, scores, np.nan).astype(scores.dtype)


def _depends_on_the_drive(config: Config) -> bool:
    """Return whether a pair score depends on the frames before, for what they usually show."""
    return config.matching.matching == 'coherent' and config.matching.subtract_background


def _pair_facts(material: Material, config: Config) -> list[object]:
    settings = flatten(config).items()
    return [
        material.content,
        {name: value for name, value in settings if name not in _SEQUENCE_ONLY},
    ]


def _online(material: Material, config: Config) -> Config:
    """Return a configuration for online mode that excludes as many frames as the set says."""
    stamps_ns = material.drives(config.encoding)[0].stamps_ns
    step_s = float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else 0.0
    recent = max(1, material.data_set.exclude_recent)
    return with_known(config, {'mode': 'online', 'exclusion_s': (recent - 0.5) * step_s})


def _recognized(material: Material, config: Config) -> dict[str, npt.NDArray[Any]]:
    online = config.online.grows
    _, reference = material.drives(config.encoding)
    reference_map = reference.reference_map
    if online:
        reference_map = ReferenceMap(config.encoding, keyframes=config.keyframes)
    recognizer = PlaceRecognizer(reference_map, config)
    recognizer.matcher.warm_up()
    geometry = Geometry(recognizer, None if online else reference.posed_map)
    number = {stamp_ns: index for index, stamp_ns in enumerate(reference.stamps_ns)}
    answers, durations, rows = [], [], []
    for frame in material.query:
        started = time.perf_counter()
        match = recognizer.process(frame)
        durations.append((time.perf_counter() - started) * 1e3)
        match, dots = geometry.add(match, frame)
        answers.append((_numbered(match, number) if online else match, dots))
        row = np.full(len(reference), np.nan, np.float32)
        known = None if match.reason is Reason.OUT_OF_ORDER else recognizer.buffer.row
        if known is not None:
            row[[number[place.stamp_ns] for place in reference_map.places[: len(known)]]] = known
        rows.append(row)
    return {**_kept(answers), 'durations_ms': np.array(durations), 'rows': np.stack(rows)}


def _numbered(match: Match, number: Mapping[int, int]) -> Match:
    """Return an answer whose references are frames of the drive."""
    candidates = tuple(
        replace(one, reference_index=number[one.reference_stamp_ns]) for one in match.candidates
    )
    return replace(match, candidates=candidates)


def _kept(answers: Iterable[tuple[Match, Dots]]) -> dict[str, npt.NDArray[Any]]:
    """Return what a cache keeps of answers and their inliers."""
    matches, dots = zip(*answers, strict=True)
    said = json.dumps([asdict(one) for one in matches], default=np.ndarray.tolist)
    return {
        'matches': np.frombuffer(said.encode(), np.uint8),
        'dots': np.concatenate(dots),
        'ends': np.cumsum([len(one) for one in dots]),
    }


def _answers(kept: Mapping[str, npt.NDArray[Any]]) -> tuple[list[Match], list[Dots]]:
    matches = [_match(one) for one in json.loads(bytes(kept['matches']))]
    return matches, np.split(kept['dots'], kept['ends'][:-1])


def _match(stored: dict[str, Any]) -> Match:
    candidates = tuple(
        Candidate(**{**one, 'shift': one['shift'] and tuple(one['shift'])})
        for one in stored['candidates']
    )
    return Match(
        **{
            **stored,
            'status': Status(stored['status']),
            'reason': Reason(stored['reason']),
            'candidates': candidates,
            'shift_px': stored['shift_px'] and tuple(stored['shift_px']),
            'localization': stored['localization'] and _localization(stored['localization']),
            'relative_pose': stored['relative_pose'] and _relative(stored['relative_pose']),
            'anchor': stored['anchor'] and Anchor(**stored['anchor']),
        }
    )


def _relative(stored: dict[str, Any]) -> RelativePose:
    said = {name: value and tuple(value) for name, value in stored.items() if name in _VECTORS}
    return RelativePose(**{**stored, **said, 'covariance': np.array(stored['covariance'])})


def _localization(stored: dict[str, Any]) -> Localization:
    return Localization(**{**stored, 'state': LocalizationState(stored['state'])})
