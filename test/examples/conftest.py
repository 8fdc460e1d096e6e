# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The modules of the example, which are not installed."""

import contextlib
from pathlib import Path
import sys
import warnings

FOLDER = Path(__file__).resolve().parents[2] / 'examples' / 'pose_graph'
sys.path.insert(0, str(FOLDER))
sys.path.insert(0, str(Path(__file__).parent))
for name in ('closures', 'bridges'):
    sys.path.insert(0, str(FOLDER.parent / name))

# A library that message packages load at their first use is not clean itself.
with contextlib.suppress(ImportError), warnings.catch_warnings():
    warnings.simplefilter('ignore')
    import rosidl_generator_py  # noqa: F401
