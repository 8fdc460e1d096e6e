# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recogniser of the places of a fleet; what `Session` is to one map."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.cameras import Cameras
from convseq_ros.core.compiled import slow_path
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.errors import FleetError
from convseq_ros.fleet.fleet import Fleet


class FleetSession:
    """Recognises places in all maps of a fleet, exactly as in one map merged from them."""

    def __init__(
        self,
        client: Any,
        paths: Sequence[Path],
        config: Config,
        timeout_s: float = 60.0,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        if config.matching.search != 'shortlist':
            raise FleetError('search exhaustive: a fleet answers by shortlist; leave it out')
        if config.online.mode != 'preloaded':
            mode = config.online.mode
            raise FleetError(f'mode {mode}: maps of a fleet do not grow; leave it out')
        self.fleet = Fleet(client, paths, timeout_s)
        reference_map = self.fleet.reference_map
        coarse = partial(self.fleet.scores, config.matching.both_directions)
        self.cameras = Cameras(reference_map, config, sources, coarse, describe)
        self.recognizer = self.cameras.first
        self.slow = '' if config.matching.kernel == 'numpy' else slow_path()

    @property
    def missing(self) -> list[str]:
        """Which maps do not answer, and why, a line each."""
        return [*self.fleet.missing.values()]
