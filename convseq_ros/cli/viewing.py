# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A replay in the viewer of rerun: query, match, field of displacement, path and closures."""

from pathlib import Path
from typing import Any

from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.place import shown
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
from convseq_ros.errors import ConvseqError, pip_install
import numpy as np

_GREEN, _GREY, _YELLOW = (63, 185, 80), (140, 140, 140), (230, 200, 40)


class Viewer:
    """Shows frame after frame, or writes a .rrd file; ConvseqError without rerun."""

    def __init__(self, file: Path | None = None) -> None:
        try:
            import rerun
        except ImportError:
            raise ConvseqError(f'--view needs rerun: {pip_install("rerun-sdk")}') from None
        self._rerun: Any = rerun
        self._closures: list[list[tuple[float, float, float]]] = []
        self._map: Any = None
        rerun.init('convseq_ros', spawn=file is None)
        if file:
            rerun.save(str(file))

    def close(self) -> None:
        """Send what is left."""
        self._rerun.disconnect()

    def write(
        self, frame: Frame, match: Match, recognizer: PlaceRecognizer, duration_ms: float
    ) -> None:
        rerun, best, known = self._rerun, match.best, recognizer.reference_map
        rerun.set_time('time', timestamp=np.datetime64(match.query_stamp_ns, 'ns'))
        rerun.log('answer/score', rerun.Scalars(best.score if best else 0.0))
        rerun.log('answer/confidence', rerun.Scalars(match.confidence or 0.0))
        rerun.log('answer/ms', rerun.Scalars(duration_ms))
        rerun.log('answer/reason', rerun.TextLog(match.reason.value))
        gray = upright(frame, known.encoding).gray
        if gray is not None:
            rerun.log('query', rerun.Image(gray, 'L').compress(80))
        picture = shown(known.thumbnail(best.reference_index)) if best else None
        if picture is not None:
            rerun.log('match', rerun.Image(picture, 'L'))
        if gray is not None and best:
            height, width = gray.shape
            field = recognizer.buffer.field(best) * (height, width, height, width, 1)
            moved = field[:, 2:4] - field[:, :2]
            colors = [_GREEN if is_inlier else _GREY for is_inlier in field[:, 4]]
            rerun.log(
                'query/displacement',
                rerun.Arrows2D(origins=field[:, 1::-1], vectors=moved[:, ::-1], colors=colors),
            )
        self._show_places(frame, match, recognizer)

    def _show_places(self, frame: Frame, match: Match, recognizer: PlaceRecognizer) -> None:
        rerun, places = self._rerun, recognizer.reference_map.places
        if self._map is not recognizer.reference_map:
            self._map = recognizer.reference_map
            positions = [place.pose.position for place in places if place.pose]
            rerun.log('map/places', rerun.Points3D(positions, colors=_GREY), static=True)
        accepted = match.accepted
        place = places[accepted.reference_index].pose if accepted else None
        if place:
            rerun.log('map/match', rerun.Points3D([place.position], colors=_GREEN, radii=0.5))
        if place and frame.pose:
            self._closures.append([frame.pose.position, place.position])
            rerun.log('map/closures', rerun.LineStrips3D(self._closures, colors=_YELLOW))
        if frame.pose:
            rerun.log('map/query', rerun.Points3D([frame.pose.position], colors=_YELLOW))
