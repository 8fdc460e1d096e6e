# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A query with as many salient regions as wanted: what a pair costs grows with them."""

from dataclasses import replace

from convseq_ros.core.encoding.entropy import MAX_BITS
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np


def with_salient(found: Descriptor, matching: str, count: int) -> tuple[Descriptor, float]:
    """
    Return a descriptor, and the saliency threshold that makes so many of its regions salient.

    Parameters
    ----------
    found : Descriptor
        Of an image.
    matching : str
        'coherent', with regions of 3 x 3 cells, or 'regional', of 2 x 2.
    count : int
        Salient regions; all if there are fewer.

    """
    span = 3 if matching == 'coherent' else 2
    means = cv2.boxFilter(found.cell_entropy, -1, (span, span), anchor=(0, 0))
    means = means[: 1 - span, : 1 - span].ravel()
    ranks = np.argsort(np.argsort(-means, kind='stable'))
    salient = ranks < count
    least_bits = means[salient].min()
    if matching == 'regional':
        return replace(found, salient=salient), least_bits / MAX_BITS
    return found, least_bits / MAX_BITS - 1e-9
