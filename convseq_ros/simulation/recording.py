# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive as a ROS 2 recording, and the truth between two drives."""

from collections.abc import Iterable
import os
from pathlib import Path
import tempfile
from typing import Any

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import Shot
import cv2
import numpy as np
import numpy.typing as npt


def write_recording(
    path: Path,
    frames: Iterable[Shot],
    topic: str = '/camera/image_raw',
    compressed: bool = False,
    odom_topic: str = '/odom',
) -> None:
    """
    Write an mcap recording of images and, if its topic is not empty, odometry.

    The folder appears under its name only when it is complete.

    Parameters
    ----------
    path : Path
        Folder to make.
    frames : iterable of Shot
        What `draw` yields; read one at a time.
    topic : str
        Of sensor_msgs/Image (bgr8), or sensor_msgs/CompressedImage (JPEG) if `compressed`.
    compressed : bool
        Smaller, but no longer pixel for pixel.
    odom_topic : str
        Of nav_msgs/Odometry.

    Raises
    ------
    ConvseqError
        If the folder exists already or rosbags is not installed.

    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise ConvseqError('rosbags is not installed; run `pip install rosbags`') from None
    path = Path(path)
    if path.exists():
        raise ConvseqError(f'{path}: exists already; remove it or choose another name')
    store = get_typestore(Stores.ROS2_JAZZY)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f'.{path.name}.', dir=path.parent) as folder:
        unfinished = Path(folder) / path.name
        with Writer(unfinished, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            message = _compressed_message if compressed else _image_message
            kind = f'sensor_msgs/msg/{"CompressedImage" if compressed else "Image"}'
            images = writer.add_connection(topic, kind, typestore=store)
            odometry = writer.add_connection(
                odom_topic, 'nav_msgs/msg/Odometry', typestore=store
            ) if odom_topic else None
            for shot in frames:
                data = store.serialize_cdr(message(store.types, shot), kind)
                writer.write(images, shot.stamp_ns, data)
                if odometry is not None:
                    odom = _odometry_message(store.types, shot)
                    data = store.serialize_cdr(odom, 'nav_msgs/msg/Odometry')
                    writer.write(odometry, shot.stamp_ns, data)
        os.replace(unfinished, path)


def _header(types: Any, shot: Shot, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(shot.stamp_ns, 1_000_000_000)
    stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)


def _image_message(types: Any, shot: Shot) -> Any:
    height, width = shot.image.shape[:2]
    return types['sensor_msgs/msg/Image'](
        header=_header(types, shot, 'camera'), height=height, width=width, encoding='bgr8',
        is_bigendian=0, step=3 * width, data=np.ascontiguousarray(shot.image).reshape(-1),
    )


def _compressed_message(types: Any, shot: Shot) -> Any:
    _, data = cv2.imencode('.jpg', shot.image, [cv2.IMWRITE_JPEG_QUALITY, 92])
    header = _header(types, shot, 'camera')
    return types['sensor_msgs/msg/CompressedImage'](header=header, format='jpeg', data=data)


def _odometry_message(types: Any, shot: Shot) -> Any:
    vector, unknown = types['geometry_msgs/msg/Vector3'], np.zeros(36)
    x, y, z = shot.pose.position
    qx, qy, qz, qw = shot.pose.orientation
    pose = types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
        orientation=types['geometry_msgs/msg/Quaternion'](x=qx, y=qy, z=qz, w=qw),
    )
    twist = types['geometry_msgs/msg/Twist'](
        linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
    )
    return types['nav_msgs/msg/Odometry'](
        header=_header(types, shot, 'map'), child_frame_id='base_link',
        pose=types['geometry_msgs/msg/PoseWithCovariance'](pose=pose, covariance=unknown),
        twist=types['geometry_msgs/msg/TwistWithCovariance'](twist=twist, covariance=unknown),
    )


def nearest_reference(
    query_distances: npt.ArrayLike, reference_distances: npt.ArrayLike
) -> npt.NDArray[np.int64]:
    """
    Return for every query the index of the reference that is nearest along the street.

    Parameters
    ----------
    query_distances, reference_distances : array of floats, shapes (Q,) and (R,)
        Metres along the street, in any order; R >= 1.

    Returns
    -------
    ndarray of int64, shape (Q,)
        The first one if several are as near.

    """
    references = np.asarray(reference_distances, dtype=np.float64)
    queries = np.asarray(query_distances, dtype=np.float64)
    order = np.argsort(references, kind='stable')
    ordered = references[order]
    after = np.searchsorted(ordered, queries).clip(0, len(ordered) - 1)
    before = (after - 1).clip(0)
    nearer = np.abs(queries - ordered[before]) <= np.abs(ordered[after] - queries)
    chosen = np.where(nearer, ordered[before], ordered[after])
    found: npt.NDArray[np.int64] = order[np.searchsorted(ordered, chosen)].astype(np.int64)
    return found
