# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small drawn data sets: a strip of texture seen twice through a moving window."""

from dataclasses import dataclass
from pathlib import Path

from convseq_ros.config import (
    AcceptanceConfig,
    Config,
    EncodingConfig,
    EVERY_FRAME,
    MatchingConfig,
    SequenceConfig,
)
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.material import open_material
import cv2
import numpy as np
from pictures import written
import pytest

SIDE_PX = 128
STEP_PX = 24
COUNT = 24
QUICK = Config(
    encoding=EncodingConfig(image_size_px=SIDE_PX, saliency_threshold=0.2),
    matching=MatchingConfig(matching='regional', search='exhaustive'),
    sequence=SequenceConfig(min_length=2, max_overlap_length=3, max_length=4),
    acceptance=AcceptanceConfig(rival_distance=3),
    keyframes=EVERY_FRAME,
)


def strip(seed):
    """Return a long texture, uint8 of shape (128, W)."""
    noise = np.random.default_rng(seed).random((SIDE_PX, STEP_PX * COUNT * 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def views(count=COUNT, seed=0, start=0, noise=0.0):
    """Yield the windows along a strip, perhaps with noise."""
    texture = strip(seed)
    generator = np.random.default_rng(seed + 1)
    for index in range(count):
        left = start + index * STEP_PX
        view = texture[:, left : left + SIDE_PX].astype(float)
        view += generator.normal(0, noise, view.shape) if noise else 0
        yield np.clip(view, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Street:
    """A drawn data set on disk."""

    folder: Path
    file: Path

    def write(self, text, name='street.yaml'):
        (self.folder / name).write_text(text)
        return self.folder / name

    def open(self, name='street.yaml', config=QUICK):
        data_set = open_data_set(str(self.folder / name))
        return open_material(data_set, config.encoding)


CLOSED_SET = """
name: street
query: {path: query, count: 24}
reference: {path: reference}
truth: {kind: identity, tolerance: 1}
"""


@pytest.fixture
def quick():
    """Return parameters for images of 128 px and short sequences."""
    return QUICK


@pytest.fixture
def street(tmp_path):
    written(tmp_path / 'reference', views())
    written(tmp_path / 'query', views(start=3, noise=4.0))
    made = Street(tmp_path, tmp_path / 'street.yaml')
    made.write(CLOSED_SET)
    return made


@pytest.fixture
def loop(tmp_path):
    """Return a drive twice round the same way, to be matched against its own past."""
    images = [*views(36), *views(36, noise=3.0, start=2)]
    written(tmp_path / 'drive', images)
    (tmp_path / 'loops.csv').write_text(
        'query,reference\n' + ''.join(f'{index},{index - 36}\n' for index in range(36, 72))
    )
    made = Street(tmp_path, tmp_path / 'street.yaml')
    made.write("""
name: loop
query: {path: drive}
truth: {kind: table, path: loops.csv, tolerance: 1}
exclude_recent: 20
""")
    return made
