# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Programs that tests run to their end, and what they wait for."""

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import time
from typing import Any

from convseq_ros.core import compiled
import pytest


def run(*command: Any, **more: Any) -> subprocess.CompletedProcess[str]:
    """Return what a program said, and its exit code."""
    words = [*map(str, command)]
    return subprocess.run(words, capture_output=True, text=True, check=False, **more)


def wait_for(condition: Callable[[], object], patience_s: float = 180.0) -> None:
    """Look again and again until a condition holds; AssertionError if it never does."""
    until_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < until_s, 'waited in vain'
        time.sleep(0.002)


def needs_library() -> None:
    """Skip a test where the kernels are not compiled."""
    if not compiled.available():
        pytest.skip(f'no compiled kernels: {compiled.library().problem}')


def open_files(path: Path) -> int:
    """Return how many descriptors this process has of files whose names begin with a path."""
    links = [os.path.realpath(f'/proc/self/fd/{name}') for name in os.listdir('/proc/self/fd')]
    return sum(link.startswith(str(path)) for link in links)
