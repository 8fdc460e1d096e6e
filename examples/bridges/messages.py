# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fills the messages of the back ends; the message types are arguments.

`kinds` maps names like 'rtabmap_msgs/msg/Link' to types that take all fields as keywords.
"""

from collections.abc import Callable, Mapping
from typing import Any
import zlib

from keyframes import Closure
import numpy as np

Kinds = Mapping[str, Callable[..., Any]]
_USER_CLOSURE = 4  # rtabmap/core/Link.h: kUserClosure
_LOOP_CLOSURE = 1  # pose_graph_tools_msgs/PoseGraphEdge: LOOPCLOSE
_NO_ROBOT = 2**32 - 1  # the largest uint32, which no robot has as its id
_OURS = 1  # rtabmap_msgs/GlobalDescriptor: the kind of descriptor
_CV_32FC1 = 5  # OpenCV's code of a float matrix


def rtabmap_link(kinds: Kinds, query: int, reference: int, closure: Closure) -> Any:
    """Return rtabmap_msgs/Link from the newer to the older node."""
    back = closure.inverse
    x, y, z = back.position.tolist()
    transform = kinds['geometry_msgs/msg/Transform'](
        translation=kinds['geometry_msgs/msg/Vector3'](x=x, y=y, z=z),
        rotation=_quaternion(kinds, back),
    )
    return kinds['rtabmap_msgs/msg/Link'](
        from_id=query,
        to_id=reference,
        type=_USER_CLOSURE,
        transform=transform,
        information=back.information.ravel(),
    )


def rtabmap_descriptor(kinds: Kinds, header: Any, descriptor: np.ndarray) -> Any:
    """Return rtabmap_msgs/GlobalDescriptor of a vector."""
    floats = np.asarray(descriptor, '<f4').ravel()
    shape = np.array([1, len(floats), _CV_32FC1], '<i4')
    # rtabmap/core/Compression.h: zlib, then rows, columns and type of the matrix.
    data = np.frombuffer(zlib.compress(floats.tobytes()) + shape.tobytes(), np.uint8)
    empty = np.zeros(0, np.uint8)
    return kinds['rtabmap_msgs/msg/GlobalDescriptor'](
        header=header, type=_OURS, info=empty, data=data
    )


def swarm_local_match(kinds: Kinds, query: int, reference: int) -> Any:
    """Return a Swarm-SLAM match of two keyframes of one robot; Swarm-SLAM registers them."""
    kind = kinds['cslam_common_interfaces/msg/LocalKeyframeMatch']
    return kind(keyframe0_id=query, keyframe1_id=reference)


def swarm_robot_matches(
    kinds: Kinds, query: tuple[int, int], reference: tuple[int, int], weight: float
) -> Any:
    """
    Return a Swarm-SLAM match list of two robots; a keyframe is a robot and a number.

    Each robot ignores its own messages.
    """
    match = kinds['cslam_common_interfaces/msg/InterRobotMatch'](
        robot0_id=query[0],
        robot0_keyframe_id=query[1],
        robot1_id=reference[0],
        robot1_keyframe_id=reference[1],
        weight=weight,
    )
    kind = kinds['cslam_common_interfaces/msg/InterRobotMatches']
    return kind(robot_id=_NO_ROBOT, matches=[match])


def kimera_edge(
    kinds: Kinds, header: Any, query: int, reference: int, closure: Closure, robot: int = 0
) -> Any:
    """Return pose_graph_tools_msgs/PoseGraphEdge from the older to the newer node."""
    return kinds['pose_graph_tools_msgs/msg/PoseGraphEdge'](
        header=header,
        key_from=reference,
        key_to=query,
        robot_from=robot,
        robot_to=robot,
        type=_LOOP_CLOSURE,
        pose=_pose(kinds, closure),
        covariance=closure.covariance.ravel(),
    )


def _pose(kinds: Kinds, closure: Closure) -> Any:
    x, y, z = closure.position.tolist()
    position = kinds['geometry_msgs/msg/Point'](x=x, y=y, z=z)
    return kinds['geometry_msgs/msg/Pose'](
        position=position, orientation=_quaternion(kinds, closure)
    )


def _quaternion(kinds: Kinds, closure: Closure) -> Any:
    x, y, z, w = closure.orientation.tolist()
    return kinds['geometry_msgs/msg/Quaternion'](x=x, y=y, z=z, w=w)
