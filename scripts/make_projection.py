# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Create convseq_ros/core/encoding/projection.npy from the frames of one indoor drive.

Usage: python scripts/make_projection.py FOLDER [OUTPUT], with FOLDER the 84 pictures of RTAB-Map's
loop-closure sequence (introlab/rtabmap, BSD-3-Clause). See projection.md beside the output.
"""

from pathlib import Path
import sys

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding import regions as regions_module
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import joined_regions
from convseq_ros.sources import open_source
import numpy as np
import numpy.typing as npt

NUMBERS = 32
LINEAR = EncodingConfig(resize='linear')  # as for the stored projection
REGULARISATION = 0.02


def fit(folder: Path) -> npt.NDArray[np.float32]:
    """Return the mean and the scaled leading axes as columns: float32 (72, 33)."""
    frames = [frame.gray for frame in open_source(folder)][::2]
    regions = np.concatenate(
        [
            joined_regions(describe(gray, LINEAR).cells).astype(np.float64)
            for gray in frames
            if gray is not None
        ]
    )
    mean = regions.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov(regions.T, bias=True))
    values, vectors = values[::-1][:NUMBERS], vectors[:, ::-1][:, :NUMBERS]
    axes = vectors / np.sqrt(values + REGULARISATION * values[0])
    axes *= np.sign(axes[np.abs(axes).argmax(axis=0), range(NUMBERS)])
    return np.column_stack((mean, axes)).astype(np.float32)


if __name__ == '__main__':
    default = Path(regions_module.__file__).with_name('projection.npy')
    np.save(Path(sys.argv[2]) if len(sys.argv) > 2 else default, fit(Path(sys.argv[1])))
