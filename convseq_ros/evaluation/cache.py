# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors that are kept between runs: files of NumPy, without pickle, each complete."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

from convseq_ros.errors import one_line
from convseq_ros.io.regular_file import complete_or_absent
import numpy as np
import numpy.typing as npt

_FORMAT = 1  # version of the files


class Made(NamedTuple):
    """What is made of images."""

    facts: Mapping[str, Any]  # as JSON holds them
    rows: Mapping[str, Sequence[npt.NDArray[Any]]]  # arrays (n, ...) by name


@dataclass(frozen=True, slots=True)
class Cache:
    """A folder with a file for each key; `warn` gets a line about a file that cannot be read."""

    folder: Path
    warn: Callable[[str], None]

    def once(self, key: str, make: Callable[[], Made]) -> Made:
        """
        Return what is kept under a key, which says all that it depends on; or make and keep it.

        A damaged file is made again. OSError, which names the file, if it cannot be written.
        """
        key = f'format {_FORMAT} {key}'
        path = self.folder / f'{hashlib.sha256(key.encode()).hexdigest()}.npz'
        if path.exists():
            try:
                return _read(path, key)
            except Exception as error:
                self.warn(f'{path}: cannot be read ({one_line(error)}); it is made again')
        made = make()
        lengths = {name: [len(row) for row in rows] for name, rows in made.rows.items()}
        arrays: dict[str, Any] = {of: np.concatenate(made.rows[of]) for of in lengths}
        with complete_or_absent(path) as part:
            np.savez(part, about=np.array(json.dumps([key, made.facts, lengths])), **arrays)
        return made


def _read(path: Path, key: str) -> Made:
    """Return what a file keeps; its checksums are those of a zip file."""
    with path.open('rb') as file, np.load(file, allow_pickle=False) as stored:
        kept_key, facts, lengths = json.loads(str(stored['about']))
        if kept_key != key:
            raise ValueError('it is of other images or settings')
        ends = {name: np.cumsum(each) for name, each in lengths.items()}
        return Made(facts, {name: np.split(stored[name], ends[name][:-1]) for name in ends})
