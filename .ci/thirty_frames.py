# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draw two drives of 30 frames, or print the answers: what must not depend on the processor.

Usage: thirty_frames.py draw FOLDER, then thirty_frames.py answer FOLDER on each machine; or send
FOLDER, which publishes the second drive to a live node.
"""

from pathlib import Path
import sys
import time

from convseq_ros.app.map_builder import build_map
from convseq_ros.config import Config, with_values
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.sources import open_source
import cv2
import numpy as np

COUNT = 30
_STEP_PX, _SIZE = 24, (960, 540)  # reduced to 512 px, as a camera's pictures are


def draw(folder: Path) -> None:
    """Write JPEGs of a long picture, seen through a moving window, and again a little aside."""
    rng = np.random.default_rng(0)
    wide = np.zeros((_SIZE[1] + 40, _SIZE[0] + COUNT * _STEP_PX + 40))
    for sigma in (2, 6, 20):
        wide += cv2.GaussianBlur(rng.normal(0, sigma, wide.shape), (0, 0), sigma)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    for name, offset, noise in (('first', 0, 0), ('second', 12, 12)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for index in range(COUNT):
            left = index * _STEP_PX + offset
            seen = wide[offset : offset + _SIZE[1], left : left + _SIZE[0]].astype(float)
            seen += rng.normal(0, noise, seen.shape) if noise else 0
            path = folder / name / f'{index:03}.jpg'
            cv2.imwrite(str(path), seen.clip(0, 255).astype(np.uint8))


def answer(folder: Path) -> None:
    """Print the checksum of the map's cells, and every frame's answer."""
    config = with_values(Config(), {'keyframe_overlap': 1.0, 'stationary_glance': 0.0})
    made = build_map(open_source(folder / 'first'), None, config)
    print(len(made), np.sum([made.cells(index).astype(np.float64) for index in range(len(made))]))
    recognizer = PlaceRecognizer(made, config)
    for frame in open_source(folder / 'second'):
        match = recognizer.process(frame)
        best = match.best and (match.best.reference_index, f'{match.best.score:.5f}')
        print(match.query_index, match.reason, match.sequence_length, best)


def send(folder: Path) -> None:
    """Publish the second drive on /image, five images a second, once a node listens."""
    from convseq_ros.node.conversions import image_message, stamp_from_ns
    import rclpy
    from rclpy.duration import Duration
    from sensor_msgs.msg import Image
    from std_msgs.msg import Header

    rclpy.init()
    publisher = rclpy.create_node('camera').create_publisher(Image, '/image', 2 * COUNT)
    while not publisher.get_subscription_count():
        time.sleep(0.1)
    for frame in open_source(folder / 'second'):
        header = Header(stamp=stamp_from_ns(frame.stamp_ns), frame_id='camera')
        publisher.publish(image_message(frame.gray, header))
        time.sleep(0.2)
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    rclpy.shutdown()


if __name__ == '__main__':
    {'draw': draw, 'answer': answer, 'send': send}[sys.argv[1]](Path(sys.argv[2]))
