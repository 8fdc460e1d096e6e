# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a stranger wrote, for a terminal."""


def printable(text: str) -> str:
    """Return a stranger's words without what is more than text to a terminal."""
    return ''.join(one if one.isprintable() else '?' for one in text)
