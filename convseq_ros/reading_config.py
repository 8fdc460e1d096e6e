# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of what is read; written once, as in `config`."""

from dataclasses import dataclass

from convseq_ros.parameter import Checked, parameter


# fmt: off
@dataclass(frozen=True, slots=True)
class ReadingConfig(Checked):
    """What is too large to be decoded, whoever sent it."""

    max_image_mpx: float = parameter(
        64.0, 'An image that declares more pixels than this is unreadable: it is not decoded, '
        'and takes no memory. Decoding takes 4 to 10 bytes a pixel.',
        unit='Mpx', low=0.01, high=1000.0,
    )
    max_chunk_mb: float = parameter(
        256.0, 'A chunk of a recording that declares more is not inflated, nor, of chunks of the '
        'same time, twice as much. Live images have none.', unit='MB', low=1.0, high=100_000.0,
    )


# fmt: on
