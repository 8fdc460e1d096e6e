# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topic of a camera is told by its name from others that carry images."""

from convseq_ros.sources.topic_rank import best, image_rank, one_of_each_camera
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
    assert best(reversed(topics), image_rank) == [topics[0]]


def test_the_namespace_does_not_change_the_rank_of_a_topic():
    assert image_rank('/ir_rover/image_raw', '/ir_rover/') == image_rank('/image_raw')


def test_cameras_of_one_kind_are_equally_good():
    pair = ['/left/image_raw', '/right/image_raw']
    assert best(pair, image_rank) == pair
    assert best([], image_rank) == []


def test_several_topics_of_one_camera_count_as_one():
    forms = ['/front/image_rect', '/front/image_raw', '/rear/image_color', '/rear/image_mono']
    assert one_of_each_camera(forms) == ['/front/image_raw', '/rear/image_color']
    unlike = ['/front/compressed', '/rear/compressed']
    assert one_of_each_camera(unlike) == unlike
