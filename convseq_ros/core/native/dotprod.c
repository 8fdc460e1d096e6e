// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// ARM with dot products: Cortex-A76 and all since, so Raspberry Pi 5 and Jetson Orin.
#ifdef __aarch64__
#pragma GCC target("arch=armv8.2-a+dotprod")
#define VARIANT dotprod
#define LANES 4
#define ROWS 10
#include "vectors.h"

typedef int8x8_t QueryStep; // in the first lane, which products take for all

static inline QueryStep query_step(const int8_t *row, int step)
{
    int32_t four;
    memcpy(&four, row + 4 * step, sizeof four);
    return (int8x8_t)(int32x2_t){four, 0};
}

static inline Words dot(Words sum, Words reference, QueryStep query)
{
    return (Words)vdotq_lane_s32((int32x4_t)sum, (int8x16_t)reference, query, 0);
}

// Add the products of four bytes in a word with those in another word.
typedef Words Sums;
static inline Sums begun(const int32_t *start) { return (void)start, splat(0); }
static inline Words whole(Sums sum) { return sum; }
static inline Sums add_fours(Sums sum, Words one, Words other)
{
    return (Words)vdotq_s32((int32x4_t)sum, (int8x16_t)one, (int8x16_t)other);
}

#include "kernels.h"
#endif
