// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// All kernels, which return 0, or -1 if there is no memory.
#define JOIN(name, variant) convseq_##name##_##variant
#define NAMED(name, variant) JOIN(name, variant)
#define SHOWN __attribute__((visibility("default"))) // to who loads the library
#define CALL(name) NAMED(name, VARIANT) // from another kernel
#define KERNEL(name) SHOWN int CALL(name)
#ifndef OFFSET
#define OFFSET 0
#endif

#include "../encoding/kernels.c"
#include "../sequence/kernels.c"
#include "../similarity/kernels/tile.c"
#include "../similarity/kernels/coherent.c"
#include "../similarity/kernels/regional.c"
#include "../similarity/kernels/regions.c"
#include "../similarity/kernels/references.c"
#include "../similarity/kernels/coarse.c"
#include "../geometry/kernels.c"
