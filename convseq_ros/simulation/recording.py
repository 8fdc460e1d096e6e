# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes a drive as a ROS 2 recording."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import ConvseqError, load
from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.simulation.drive import Shot
import numpy as np

_IMAGE, _INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'
_ODOMETRY = 'nav_msgs/msg/Odometry'


def write_recording(
    path: Path,
    frames: Iterable[Shot],
    topic: str = '/camera/image_raw',
    odom_topic: str = '/odom',
    info_topic: str = '',
) -> None:
    """
    Write an mcap recording of images and, if `odom_topic` is set, odometry, in one step.

    Odometry of a shot is written in frame odom, and then its true pose in frame map on
    /ground_truth. With `info_topic`, every image has a CameraInfo.
    """
    bags, types = (load(f'rosbags.{name}', 'a recording') for name in ('rosbag2', 'typesys'))
    path = Path(path)
    if path.exists():
        raise ConvseqError(f'{path}: exists already; remove it or choose another name')
    store = types.get_typestore(types.Stores.ROS2_JAZZY)
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        complete_or_absent(path) as part,
        bags.Writer(part, version=9, storage_plugin=bags.StoragePlugin.MCAP) as writer,
    ):
        connections = {topic: writer.add_connection(topic, _IMAGE, typestore=store)}
        for shot in frames:
            messages = [(topic, _IMAGE, _image_message(store.types, shot))]
            messages += [
                (name, _ODOMETRY, _odometry_message(store.types, shot, frame_id, pose))
                for name, frame_id, pose in _poses(shot, odom_topic)
            ]
            if info_topic and shot.camera:
                messages.append((info_topic, _INFO, _info_message(store.types, shot, shot.camera)))
            for name, kind, message in messages:
                if name not in connections:
                    connections[name] = writer.add_connection(name, kind, typestore=store)
                writer.write(connections[name], shot.stamp_ns, store.serialize_cdr(message, kind))


def _poses(shot: Shot, odom_topic: str) -> list[tuple[str, str, Pose]]:
    """Return topic, frame and pose of every odometry message of a shot."""
    if not odom_topic:
        return []
    if shot.odometry is None:
        return [(odom_topic, 'map', shot.pose)]
    return [(odom_topic, 'odom', shot.odometry), ('/ground_truth', 'map', shot.pose)]


def _header(types: Any, shot: Shot, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(shot.stamp_ns, 1_000_000_000)
    stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)


def _image_message(types: Any, shot: Shot) -> Any:
    height, width = shot.image.shape[:2]
    return types[_IMAGE](
        header=_header(types, shot, 'camera'),
        height=height,
        width=width,
        encoding='bgr8',
        is_bigendian=0,
        step=3 * width,
        data=np.ascontiguousarray(shot.image).reshape(-1),
    )


def _info_message(types: Any, shot: Shot, camera: Camera) -> Any:
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    return types[_INFO](
        header=_header(types, shot, 'camera'),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model='plumb_bob',
        d=np.zeros(5),
        r=np.eye(3).reshape(-1),
        k=np.array((fx, 0, cx, 0, fy, cy, 0, 0, 1.0)),
        p=np.array((fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0)),
        binning_x=0,
        binning_y=0,
        roi=types['sensor_msgs/msg/RegionOfInterest'](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def _odometry_message(types: Any, shot: Shot, frame_id: str, at: Pose) -> Any:
    vector, unknown = types['geometry_msgs/msg/Vector3'], np.zeros(36)
    x, y, z = at.position
    qx, qy, qz, qw = at.orientation
    pose = types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
        orientation=types['geometry_msgs/msg/Quaternion'](x=qx, y=qy, z=qz, w=qw),
    )
    twist = types['geometry_msgs/msg/Twist'](
        linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
    )
    return types[_ODOMETRY](
        header=_header(types, shot, frame_id),
        child_frame_id='base_link',
        pose=types['geometry_msgs/msg/PoseWithCovariance'](pose=pose, covariance=unknown),
        twist=types['geometry_msgs/msg/TwistWithCovariance'](twist=twist, covariance=unknown),
    )
