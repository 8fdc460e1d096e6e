# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps, asked as one map."""

from collections.abc import Sequence
from pathlib import Path

from convseq_ros.app.cameras import Cameras
from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.map.session_slice import (
    joined,
    refuse_incompatible,
    required_slices,
    SessionSlice,
)
from convseq_ros.errors import FleetError, MapError


class Fleet:
    """
    Recognises places in all maps of a fleet, exactly as in one map merged from them.

    The maps come in the order given; cells and images stay in their files, which must stay in
    place. `missing` says which maps cannot be used, and why; the others answer. `cameras` takes
    frames; `sources` name several cameras, and `describe` is the maps' model, as in `Pipeline`.
    FleetError if `config` lets maps grow, or no map can be used.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        config: Config,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        if config.online.grows:
            mode = config.online.mode
            raise FleetError(f'mode {mode}: maps of a fleet do not grow; leave it out')
        self.missing, slices = list[str](), list[SessionSlice]()
        for path in paths:
            try:
                more = required_slices(path)
                refuse_incompatible([*slices, *more])
                slices += more
            except MapError as error:
                self.missing.append(str(error))
        if not slices:
            raise FleetError(f'no map of {len(paths)} can be opened: {self.missing[0]}')
        self.reference_map = joined(slices)
        self.cameras = Cameras(self.reference_map, config, sources, describe)
