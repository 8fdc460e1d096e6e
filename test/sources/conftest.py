# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in every storage and layout."""

import functools

import numpy as np
import pytest

LAYOUTS = (
    'mcap folder', 'mcap folder zstd', 'mcap folder compressed messages', 'mcap zstd', 'mcap lz4',
    'mcap without chunks', 'sqlite3 folder', 'sqlite3 folder compressed messages',
    'sqlite3 folder compressed file', 'ros1 bag',
)  # fmt: skip


@pytest.fixture
def pictures() -> list:
    """Twelve grey pictures, each different."""
    rng = np.random.default_rng(3)
    return [rng.integers(0, 256, (24, 32), dtype=np.uint8) for _ in range(12)]


@pytest.fixture(params=LAYOUTS)
def layout(request) -> str:
    return request.param


@pytest.fixture
def write(tmp_path):
    """Return what writes a recording of some layout and rows."""
    from recordings import write_recording

    return functools.partial(write_recording, tmp_path)
