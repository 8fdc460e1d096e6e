# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench is found in the repository; the package, before it, where it is installed."""

from pathlib import Path
import sys

sys.path.append(str(Path(__file__).resolve().parents[2]))
