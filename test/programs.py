# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Programs that tests run to their end."""

import subprocess
from typing import Any


def run(*command: Any, **more: Any) -> subprocess.CompletedProcess[str]:
    """Return what a program said, and its exit code."""
    words = [*map(str, command)]
    return subprocess.run(words, capture_output=True, text=True, check=False, **more)
