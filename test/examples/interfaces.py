# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The messages of back ends that cannot run here, by the facts of their interfaces.

Fields, types and order are those of the `.msg` files of introlab/rtabmap_ros (rtabmap_msgs),
lajoiepy/cslam's interfaces (cslam_common_interfaces), ethz-asl/voxgraph (voxgraph_msgs) and
MIT-SPARK/pose_graph_tools (pose_graph_tools_msgs), read in November 2026; names are in lower case,
as ROS 2 wants them. voxgraph is ROS 1: CDR stands for what a bridge to it would carry.
"""

from typing import Any

DEFINITIONS = {
    'rtabmap_msgs/msg/Link': """
        int32 from_id
        int32 to_id
        int32 type
        geometry_msgs/Transform transform
        float64[36] information
    """,
    'rtabmap_msgs/msg/MapGraph': """
        std_msgs/Header header
        geometry_msgs/Transform map_to_odom
        int32[] poses_id
        geometry_msgs/Pose[] poses
        rtabmap_msgs/Link[] links
    """,
    'rtabmap_msgs/msg/GlobalDescriptor': """
        std_msgs/Header header
        int32 type
        uint8[] info
        uint8[] data
    """,
    'rtabmap_msgs/msg/Point2f': 'float32 x\nfloat32 y',
    'rtabmap_msgs/msg/Point3f': 'float32 x\nfloat32 y\nfloat32 z',
    'rtabmap_msgs/msg/KeyPoint': """
        rtabmap_msgs/Point2f pt
        float32 size
        float32 angle
        float32 response
        int32 octave
        int32 class_id
    """,
    'rtabmap_msgs/msg/EnvSensor': 'std_msgs/Header header\nint32 type\nfloat64 value',
    'rtabmap_msgs/msg/LandmarkDetection': """
        std_msgs/Header header
        string landmark_frame_id
        int32 id
        float32 size
        geometry_msgs/PoseWithCovariance pose
    """,
    'rtabmap_msgs/msg/GPS': """
        float64 stamp
        float64 longitude
        float64 latitude
        float64 altitude
        float64 error
        float64 bearing
    """,
    'rtabmap_msgs/msg/SensorData': """
        std_msgs/Header header
        sensor_msgs/Image left
        sensor_msgs/Image right
        uint8[] left_compressed
        uint8[] right_compressed
        sensor_msgs/CameraInfo[] left_camera_info
        sensor_msgs/CameraInfo[] right_camera_info
        geometry_msgs/Transform[] local_transform
        sensor_msgs/PointCloud2 laser_scan
        uint8[] laser_scan_compressed
        int32 laser_scan_max_pts
        float32 laser_scan_max_range
        int32 laser_scan_format
        geometry_msgs/Transform laser_scan_local_transform
        uint8[] user_data
        uint8[] grid_ground
        uint8[] grid_obstacles
        uint8[] grid_empty_cells
        float32 grid_cell_size
        rtabmap_msgs/Point3f grid_view_point
        rtabmap_msgs/KeyPoint[] key_points
        rtabmap_msgs/Point3f[] points
        uint8[] descriptors
        rtabmap_msgs/GlobalDescriptor[] global_descriptors
        rtabmap_msgs/EnvSensor[] env_sensors
        sensor_msgs/Imu imu
        geometry_msgs/Transform imu_local_transform
        rtabmap_msgs/LandmarkDetection[] landmarks
        geometry_msgs/Pose ground_truth_pose
        rtabmap_msgs/GPS gps
    """,
    'rtabmap_msgs/msg/Node': """
        int32 id
        int32 map_id
        int32 weight
        float64 stamp
        string label
        geometry_msgs/Pose pose
        int32[] word_id_keys
        int32[] word_id_values
        rtabmap_msgs/KeyPoint[] word_kpts
        rtabmap_msgs/Point3f[] word_pts
        uint8[] word_descriptors
        rtabmap_msgs/SensorData data
    """,
    'rtabmap_msgs/msg/MapData': """
        std_msgs/Header header
        rtabmap_msgs/MapGraph graph
        rtabmap_msgs/Node[] nodes
    """,
    'cslam_common_interfaces/msg/KeyframeOdom': 'uint32 id\nnav_msgs/Odometry odom',
    'cslam_common_interfaces/msg/LocalKeyframeMatch': 'uint32 keyframe0_id\nuint32 keyframe1_id',
    'cslam_common_interfaces/msg/InterRobotMatch': """
        uint32 robot0_id
        uint32 robot0_keyframe_id
        uint32 robot1_id
        uint32 robot1_keyframe_id
        float32 weight
    """,
    'cslam_common_interfaces/msg/InterRobotMatches': """
        uint32 robot_id
        cslam_common_interfaces/InterRobotMatch[] matches
    """,
    'voxgraph_msgs/msg/LoopClosureEdge': """
        builtin_interfaces/Time timestamp_a
        builtin_interfaces/Time timestamp_b
        geometry_msgs/PoseWithCovariance t_a_b
    """,
    'voxgraph_msgs/msg/LoopClosureEdgeList': """
        std_msgs/Header header
        voxgraph_msgs/LoopClosureEdge[] loop_closure_edges
    """,
    'pose_graph_tools_msgs/msg/PoseGraphEdge': """
        int32 ODOM=0
        int32 LOOPCLOSE=1
        std_msgs/Header header
        uint64 key_from
        uint64 key_to
        int32 robot_from
        int32 robot_to
        int32 type
        geometry_msgs/Pose pose
        float64[36] covariance
    """,
    'pose_graph_tools_msgs/msg/PoseGraphNode': """
        std_msgs/Header header
        int32 robot_id
        uint64 key
        geometry_msgs/Pose pose
    """,
    'pose_graph_tools_msgs/msg/PoseGraph': """
        std_msgs/Header header
        pose_graph_tools_msgs/PoseGraphNode[] nodes
        pose_graph_tools_msgs/PoseGraphEdge[] edges
    """,
}


def type_store() -> Any:
    """Return a store of rosbags that knows all of these, and those of Jazzy."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store, types = get_typestore(Stores.ROS2_JAZZY), {}
    for name, text in DEFINITIONS.items():
        lines = '\n'.join(line.strip() for line in text.strip().splitlines())
        types.update(get_types_from_msg(lines, name))
    store.register(types)
    return store


def blank(store: Any, name: str, **fields: Any) -> Any:
    """Return a message whose other fields are zero, empty, or blank messages."""
    import numpy as np
    from rosbags.interfaces import Nodetype

    def value(described: Any) -> Any:
        kind, of = described
        if kind == Nodetype.BASE:
            return {'string': '', 'bool': False}.get(of[0], 0.0 if 'float' in of[0] else 0)
        if kind == Nodetype.NAME:
            return blank(store, of)
        (_, inner), count = of
        number = inner[0] if isinstance(inner, tuple) else None
        if number in (None, 'string'):
            return [value(of[0]) for _ in range(count or 0)]
        return np.zeros(count or 0, number)

    _, described = store.fielddefs[name]
    made = {item: fields[item] if item in fields else value(kind) for item, kind in described}
    return store.types[name](**made)
