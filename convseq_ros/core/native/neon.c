// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Any 64-bit ARM processor, such as Cortex-A53 and A72 of Raspberry Pi 3 and 4.
#ifdef __aarch64__
#define VARIANT neon
#define LANES 4
#define ROWS 10
#define WIDENED // products of bytes, two and two, are added up in 16 bits
#include "vectors.h"

typedef struct {
    int8x16_t first, second; // a query's first two bytes of four, and its last two, again and again
} QueryStep;

static inline QueryStep query_step(const int8_t *row, int step)
{
    int16_t two[2];
    memcpy(two, row + 4 * step, sizeof two);
    return (QueryStep){(int8x16_t)vdupq_n_s16(two[0]), (int8x16_t)vdupq_n_s16(two[1])};
}

static inline Words dot(Words sum, Words reference, QueryStep query)
{
    int8x16_t bytes = (int8x16_t)reference;
    int16x8_t twos = vmull_s8(vget_low_s8(bytes), vget_low_s8(query.first));
    twos = vmlal_high_s8(twos, bytes, query.second);
    return (Words)vpadalq_s16((int32x4_t)sum, twos);
}

// Add the products of four bytes in a word with those in another word, in 16 bits.
typedef struct {
    int16x8_t low, high; // four products of a word beside each other
} Sums;

static inline Sums begun(const int32_t *start)
{
    (void)start;
    return (Sums){vdupq_n_s16(0), vdupq_n_s16(0)};
}

static inline Words whole(Sums sum)
{
    return (Words)vpaddq_s32(vpaddlq_s16(sum.low), vpaddlq_s16(sum.high));
}

static inline Sums add_fours(Sums sum, Words one, Words other)
{
    int8x16_t own = (int8x16_t)one, its = (int8x16_t)other;
    sum.low = vmlal_s8(sum.low, vget_low_s8(own), vget_low_s8(its));
    sum.high = vmlal_high_s8(sum.high, own, its);
    return sum;
}

#include "kernels.h"
#endif
