# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads `~/closure` in Python. To be copied: it needs only NumPy and the message."""

from typing import Any

import numpy as np

TYPES = {2: 'u1', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}  # of sensor_msgs/PointField


def read_closure(message: Any) -> Any:
    """Return the fields of a closure by name, for example ['x'] and ['covariance']."""
    kinds = [(TYPES[f.datatype], (f.count,) if f.count > 1 else ()) for f in message.fields]
    names, offsets = [f.name for f in message.fields], [f.offset for f in message.fields]
    layout = np.dtype({'names': names, 'formats': kinds, 'offsets': offsets})
    closure = np.frombuffer(message.data, layout, 1)[0]
    if closure['layout'] != 1:
        raise ValueError(f'closure of layout {closure["layout"]}, this reads 1')
    return closure


def stamp_ns(closure: Any, name: str) -> int:
    """Return the stamp of the 'query' or the 'reference' in nanoseconds."""
    return int(closure[f'{name}_sec']) * 10**9 + int(closure[f'{name}_nanosec'])
