// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Prints what read_closure.hpp reads of a message, of which files hold the fields and the data.
#include "read_closure.hpp"
#include <cstdio>
#include <fstream>
#include <iterator>
int main(int, char ** argv)
{
  sensor_msgs::msg::PointCloud2 m;
  m.width = m.height = 1;
  std::ifstream names(argv[1]);
  sensor_msgs::msg::PointField f;
  for (int kind; names >> f.name >> f.offset >> kind >> f.count;) {
    f.datatype = kind;
    m.fields.push_back(f);
  }
  std::ifstream data(argv[2], std::ios::binary);
  m.data.assign(std::istreambuf_iterator<char>(data), {});
  m.point_step = m.row_step = m.data.size();
  m.header.stamp.sec = 5;
  const Closure c(m);
  std::printf("%d %d %u\n", c.query.sec, c.reference.sec, c.reference.nanosec);
  for (int i = 0; i < 3; ++i) {std::printf("%.17g ", c.position[i]);}
  for (int i = 0; i < 4; ++i) {std::printf("%.17g ", c.orientation[i]);}
  for (int i = 0; i < 36; ++i) {std::printf("%.17g ", c.covariance[i]);}
}
