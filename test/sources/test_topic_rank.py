# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topic of a camera is told by its name from others that carry images."""

from convseq_ros.sources.topic_rank import image_rank
import pytest

# Of drivers and of what works on their images; the first of each is the one for recognition.
REALSENSE = (
    '/camera/color/image_raw', '/camera/infra1/image_rect_raw', '/camera/infra2/image_rect_raw',
    '/camera/depth/image_rect_raw', '/camera/aligned_depth_to_color/image_raw',
)  # fmt: skip
OUSTER = (
    '/camera/image_raw', '/ouster/nearir_image', '/ouster/signal_image', '/ouster/reflec_image',
    '/ouster/range_image',
)  # fmt: skip
ZED = (
    '/zed/rgb/image_rect_color', '/zed/left/image_rect_color', '/zed/right/image_rect_color',
    '/zed/depth/depth_registered', '/zed/confidence/confidence_map',
)  # fmt: skip
KINECT = ('/rgb/image_raw', '/ir/image_raw', '/depth/image_raw', '/depth_to_rgb/image_raw')
SIMULATOR = ('/rgb', '/depth', '/semantic_segmentation')
DETECTOR = ('/front/image_raw', '/yolo/annotated')
NEAR_INFRARED_ALONE = ('/lidar/nearir_image', '/lidar/range_image')


@pytest.mark.parametrize(
    'topics', [REALSENSE, OUSTER, ZED, KINECT, SIMULATOR, DETECTOR, NEAR_INFRARED_ALONE]
)
def test_the_colour_camera_is_best(topics):
    best, *others = sorted(topics, key=image_rank)
    assert best == topics[0] and image_rank(best) < image_rank(others[0])


def test_cameras_of_one_kind_are_equally_good():
    assert image_rank('/left/image_raw') == image_rank('/right/image_rect')
