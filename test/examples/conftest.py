# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The modules of the examples, which are not installed."""

from pathlib import Path
import sys

FOLDER = Path(__file__).resolve().parents[2] / 'examples'
sys.path.insert(0, str(Path(__file__).parent))
for name in ('closures', 'bridges'):
    sys.path.insert(0, str(FOLDER / name))
