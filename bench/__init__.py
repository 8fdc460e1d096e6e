# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measures the installed package, with its kernels.

`python -m` puts the sources in this folder first, which have none; they are left out if there is
an installed package, or a path to another in PYTHONPATH.
"""

from importlib.machinery import PathFinder
from pathlib import Path
import sys

if Path(sys.path[0]).resolve() == Path(__file__).resolve().parents[1]:
    if PathFinder.find_spec('convseq_ros', sys.path[1:]):
        del sys.path[0]
