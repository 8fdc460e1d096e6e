# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The images of all data sets but the one that is measured, to learn words of."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import tempfile

from convseq_ros.cli.options import progress
from convseq_ros.evaluation.data_set import open_data_set, Part
from convseq_ros.sources.folder import pictures_in
import cv2

EVERY = 4  # of so many images one is taken, as neighbours look alike
ROADS = 'road_1', 'road_2'  # streets in no set


class OtherSets:
    """The images of sets in a folder of data; a temporary folder has links, and drawn ones."""

    def __init__(self, data: Path, names: Sequence[str]) -> None:
        self._data, self._names = data, names
        self._folder = tempfile.TemporaryDirectory()

    def folders(self, measured: str) -> list[Path]:
        """Return a folder for each set but the measured one."""
        return [self._filled(name) for name in (*self._names, *ROADS) if name != measured]

    def _filled(self, name: str) -> Path:
        """Return the folder of a set; it is filled when it is first asked for."""
        folder = Path(self._folder.name, name)
        if not folder.exists():
            folder.mkdir()
            for number, part in enumerate(self._parts(name)):
                _fill(folder, part, f'{name}-{number}')
        return folder

    def _parts(self, name: str) -> list[Part]:
        if name in ROADS:
            return [Part(self._data / name / 'images')]
        if name == 'laps':
            return [Part(self._data / name / 'drive'), Part(self._data / name / 'other')]
        data_set = open_data_set(name, self._data)
        return [part for part in (data_set.query, data_set.reference) if part]


def _fill(folder: Path, part: Part, label: str) -> None:
    drive = part.simulated
    if drive is None:
        for picture in pictures_in(part.path)[::EVERY]:
            (folder / f'{label}-{picture.name}').symlink_to(picture.resolve())
        return
    count, rate_hz = drive.num_frames // EVERY, drive.frame_rate_hz / EVERY
    sparse = replace(drive, num_frames=count, frame_rate_hz=rate_hz)
    for index, frame in enumerate(progress(sparse, count, f'drawing {label}')):
        cv2.imwrite(str(folder / f'{label}-{index}.png'), frame.gray)
