// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// ARM with dot products: Cortex-A76 and all since, so Raspberry Pi 5 and Jetson Orin.
#ifdef __aarch64__
#pragma GCC target("arch=armv8.2-a+dotprod")
#define VARIANT dotprod
#define LANES 4
#define ROWS 12
#include "vectors.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return (Words)vdotq_s32((int32x4_t)sum, (int8x16_t)reference, (int8x16_t)query);
}

#include "kernels.h"
#endif
