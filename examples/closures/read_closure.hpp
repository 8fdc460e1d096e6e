// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Reading ~/closure in C++; needs sensor_msgs only. Copy it.
#include <cstdint>
#include <stdexcept>

#include <builtin_interfaces/msg/time.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <sensor_msgs/point_cloud2_iterator.hpp>

using Reals = sensor_msgs::PointCloud2ConstIterator<double>;
using Whole = sensor_msgs::PointCloud2ConstIterator<uint32_t>;

struct Closure
{
  explicit Closure(const sensor_msgs::msg::PointCloud2 & m)  // fields follow one another as named
  : query(m.header.stamp), position(m, "x"), orientation(m, "qx"), covariance(m, "covariance")
  {
    if (*Whole(m, "layout") != 1) {throw std::runtime_error("closure of another layout than 1");}
    reference.sec = static_cast<int32_t>(*Whole(m, "reference_sec"));
    reference.nanosec = *Whole(m, "reference_nanosec");
  }
  builtin_interfaces::msg::Time query, reference;
  Reals position, orientation, covariance;  // [0] to [2], [0] to [3] (x, y, z, w), [0] to [35]
};
