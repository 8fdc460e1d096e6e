# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the figures were measured on."""

import os
from typing import Any

from convseq_ros.core.compiled import library
from convseq_ros.evaluation.provenance import provenance
import numpy as np


def described() -> dict[str, Any]:
    """Return machine, kernels, libraries and date, ready for JSON."""
    found = provenance()
    blas = np.show_config(mode='dicts')['Build Dependencies']['blas']
    found['machine'] |= {
        'cores': len(os.sched_getaffinity(0)),
        'memory_gb': round(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9, 1),
        'kernels': library().variant or 'none',
        'blas': f'{blas["name"]} {blas["version"]}',
        'load': round(os.getloadavg()[0], 2),
    }
    return found
