# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run peers.py with DBoW2 itself (C++) in place of the vocabulary that is written anew.

Usage: python scripts/dbow2.py CLONE ..., where CLONE is what `git clone` makes of
https://github.com/dorian3d/DBoW2, and the rest are the options of peers.py, as --methods ORB. It
needs g++ and the headers of OpenCV (Debian: libopencv-core-dev).
"""

from collections.abc import Sequence
import ctypes
from dataclasses import replace
from pathlib import Path
import subprocess
import sys
import tempfile

from convseq_ros.baselines.vocabulary import BRANCHES
from convseq_ros.evaluation import peers as package_peers
import numpy as np
import numpy.typing as npt
import peers

Bits = npt.NDArray[np.uint8]  # (n, 32)
PARTS = 'BowVector', 'FeatureVector', 'FORB', 'QueryResults', 'ScoringObject'


def library_of(clone: Path, folder: Path) -> ctypes.CDLL:
    """Return DBoW2's vocabulary, compiled into a folder."""
    made, headers = folder / 'dbow2.so', (clone / 'include', clone / 'include' / 'DBoW2')
    files = Path(__file__).with_suffix('.cpp'), *(clone / 'src' / f'{name}.cpp' for name in PARTS)
    include = [f'-I{header}' for header in (*headers, '/usr/include/opencv4')]
    options = '-O2', '-shared', '-fPIC', *include, *map(str, files), '-lopencv_core'
    subprocess.run(['g++', *options, '-o', str(made)], check=True)
    library = ctypes.CDLL(str(made))
    library.learn.restype, library.size.restype = ctypes.c_void_p, ctypes.c_long
    return library


class Vocabulary:
    """Words that DBoW2 learns, as `convseq_ros.baselines.vocabulary.Vocabulary` gives them."""

    library: ctypes.CDLL

    def __init__(self, images: Sequence[Bits], levels: int) -> None:
        counts = np.array([len(one) for one in images], np.int64)
        tree = ctypes.c_long(len(images)), BRANCHES, levels
        found = self.library.learn(np.concatenate(images).ctypes, counts.ctypes, *tree)
        self._learnt = ctypes.c_void_p(found)
        self._count = self.library.size(self._learnt)

    def bag(self, descriptors: Bits) -> npt.NDArray[np.float32]:
        """Return the tf-idf weights of an image's words, (W,), with sum 1."""
        weights = np.zeros(self._count, np.float32)
        given = np.ascontiguousarray(descriptors)
        asked = given.ctypes, ctypes.c_long(len(given)), weights.ctypes
        self.library.bag(self._learnt, *asked)
        return weights


def main() -> None:
    """Replace the vocabulary, and print the tables of peers.py."""
    clone = Path(sys.argv.pop(1))
    with tempfile.TemporaryDirectory() as folder:
        Vocabulary.library = library_of(clone, Path(folder))
    ours = package_peers.PEERS['orb-bow']
    dbow2 = replace(ours, learn=Vocabulary, describe=Vocabulary.bag)
    package_peers.PEERS['orb-bow'] = dbow2
    peers.main()


if __name__ == '__main__':
    main()
