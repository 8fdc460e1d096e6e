# ROS 2 Jazzy with convseq_ros, as `colcon build` makes it. Not run here: there is no Docker.
# docker build --tag convseq_ros .
# docker run --rm --net=host --ipc=host --volume "$PWD:/data" convseq_ros \
#     ros2 run convseq_ros vpr_node --ros-args -p map_path:=/data/map.db -r image:=/camera/image_raw
FROM ros:jazzy-ros-base

WORKDIR /workspace
COPY . src/convseq_ros
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src --default-yes \
    && apt-get install --yes --no-install-recommends python3-pip \
    && pip install --no-cache-dir --break-system-packages rosbags mcap zstandard \
    && rm -rf /var/lib/apt/lists/*
RUN . /opt/ros/jazzy/setup.sh && colcon build
# ROS's own entry point sources /opt/ros; this one the workspace on top of it.
ENTRYPOINT ["bash", "-c", ". /workspace/install/setup.bash && exec \"$@\"", "--"]
CMD ["convseq", "info"]
