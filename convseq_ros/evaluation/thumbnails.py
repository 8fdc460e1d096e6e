# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small pictures of the frames of a data set, for people to look at."""

from pathlib import Path

from convseq_ros.core.map.place import thumbnail
from convseq_ros.evaluation.drive import Images

WIDTH_PX = 160


def write_thumbnails(folder: Path, images: Images) -> None:
    """Write one JPEG for every readable frame; a finished folder of this content is kept."""
    mark = folder / '.content'
    content = str(images.content)
    if mark.exists() and mark.read_text(encoding='utf-8') == content:
        return
    folder.mkdir(parents=True, exist_ok=True)
    mark.unlink(missing_ok=True)
    for old in folder.glob('*.jpg'):
        old.unlink()
    for index, frame in enumerate(images):
        if frame.gray is None:
            continue
        (folder / f'{index:06d}.jpg').write_bytes(thumbnail(frame.gray, WIDTH_PX))
    mark.write_text(content, encoding='utf-8')
