# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that are gone, and what to do instead."""

_RECENT = 'places are matched once the drive is 20 keyframes past them; leave it out'
RETIRED = {'exclusion_s': _RECENT, 'exclusion_m': _RECENT}


def retired(name: str) -> str:
    """Return a line about a parameter that is gone; empty for any other name."""
    return f'parameter {name!r} is gone: {RETIRED[name]}' if name in RETIRED else ''
