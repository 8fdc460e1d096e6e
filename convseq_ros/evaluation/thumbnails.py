# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small pictures of the frames of a data set, for people to look at."""

from pathlib import Path

from convseq_ros.evaluation.drive import Images
import cv2

WIDTH_PX = 160
QUALITY = 75


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
        height_px = max(1, round(frame.gray.shape[0] * WIDTH_PX / frame.gray.shape[1]))
        small = cv2.resize(frame.gray, (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
        jpeg = cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        (folder / f'{index:06d}.jpg').write_bytes(jpeg.tobytes())
    mark.write_text(content, encoding='utf-8')
