# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The entropy map of the paper (III-B), of which the program needs the means of cells only."""

from convseq_ros.core.encoding.entropy import local_entropy
import cv2


def entropy_map(gray):
    """Return the local entropy of a square image at every pixel, (S, S), in bits."""
    return cv2.resize(
        local_entropy(gray, cv2.INTER_LINEAR), gray.shape[::-1], interpolation=cv2.INTER_LINEAR
    )
