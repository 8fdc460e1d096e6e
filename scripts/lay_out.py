# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Lay out the drives of docs/howto/real_drives.md, from clones of their repositories.

Usage: python scripts/lay_out.py CLONES FOLDER, two minutes and 0.65 GB. CLONES has what `git
clone` makes of each repository that the page names. It writes FOLDER/SET/DRIVE/NUMBER.jpg, or
bmp, where NUMBER is that of the source with six digits. Drives whose clone is missing are left
out.
"""

import argparse
from pathlib import Path
import re
import subprocess
import tarfile

from drives import progress

EVERY = range(10**9)
DRIVES = {  # repository, commit and folder, and the pictures that are taken, by their numbers
    'court/0513_1442': ('ECE_148_Final', '5ca2cf1a', 'd4/data/images', range(3531, 6355, 2)),
    'court/0513_1732': ('ECE_148_Final', '5ca2cf1a', 'd4/data/images', range(6367, 9836, 2)),
    'court/0514_1407': ('ECE_148_Final', '5ca2cf1a', 'd4/data/images', range(20290, 23067, 2)),
    'court/0514_1240': ('ECE_148_Final', '5ca2cf1a', 'd4/data_old/images', range(0, 3447, 2)),
    'lot/a': ('eDonkeys', '7073461e', 'Data/images', range(224, 889, 2)),
    'lot/b': ('eDonkeys', '7073461e', 'Data/images', range(889, 1443, 2)),
    'office/1202': ('mycar', '91f8a74b', 'data/images', range(0, 2184, 4)),
    'office/1202_other_way': ('mycar', '91f8a74b', 'data/images', range(2200, 4000, 4)),
    'office/1209': ('mycar', 'ba72b28e', 'data/images', range(0, 4000, 4)),
    'office/1230_other_way': ('mycar', '5152c263', 'data/images', range(0, 4000, 4)),
    'office/0306_other_way': ('mycar', '1cfe7415', 'data/images', range(0, 1001, 4)),
    'office/0306': ('mycar', '1cfe7415', 'data/images', range(1152, 2391, 4)),
    'house/a': ('tunnelrobot', '7cffa474', 'mycar/data/images', range(1311)),
    'house/b': ('tunnelrobot', '7cffa474', 'mycar/data/images', range(1311, 3844)),
    'park/0': ('GRIEF', '7b42be04', 'testing_data/season_00', EVERY),
    'park/1': ('GRIEF', '7b42be04', 'testing_data/season_01', EVERY),
    'room/walk': ('GaussianSplattingExample', 'ec6340f7', 'data/input', EVERY),
    'straight/drive': ('Car', '625945e3', 'images', range(0, 12200, 10)),
    # Of the benchmark's own sets, the one whose truth is the frame's number.
    'corridor/query': ('VPR-Bench', '1f78cf83', 'datasets/corridor/query', EVERY),
    'corridor/ref': ('VPR-Bench', '1f78cf83', 'datasets/corridor/ref', EVERY),
}  # fmt: skip
PICTURE = re.compile(r'(\d+)(?:_cam.image_array_)?\.(jpg|bmp)$')


def lay_out(clone: Path, commit: str, folder: str, numbers: range, output: Path) -> int:
    """Write the pictures of a folder that have these numbers; return how many there are."""
    output.mkdir(parents=True, exist_ok=True)
    git, count = ['git', '-C', str(clone), 'archive', '--format=tar', f'{commit}:{folder}'], 0
    with subprocess.Popen(git, stdout=subprocess.PIPE) as process:
        with tarfile.open(fileobj=process.stdout, mode='r|') as files:
            for file in files:
                found = PICTURE.search(file.name)
                content = files.extractfile(file)
                if found and content and int(found[1]) in numbers:
                    path = output / f'{int(found[1]):06d}.{found[2]}'
                    path.write_bytes(content.read())
                    count += 1
    return count


def main() -> None:
    """Lay out every drive whose clone is there."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('clones', type=Path)
    parser.add_argument('folder', type=Path)
    chosen = parser.parse_args()
    for drive, (name, commit, folder, numbers) in DRIVES.items():
        clone = chosen.clones / name
        if not clone.exists():
            progress(f'{drive}: {clone} is missing')
            continue
        count = lay_out(clone, commit, folder, numbers, chosen.folder / drive)
        progress(f'{drive}: {count} pictures')


if __name__ == '__main__':
    main()
