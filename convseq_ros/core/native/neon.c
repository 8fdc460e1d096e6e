// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Any 64-bit ARM processor, such as Cortex-A53 and A72 of Raspberry Pi 3 and 4.
#ifdef __aarch64__
#define VARIANT neon
#include "neon.h"

typedef int8_t QueryNumber;
typedef struct {
    int8x16_t lower, upper; // numbers 0 and 1, 2 and 3, again and again
} QueryStep;
enum { OFFSET = 0, STEPS = NUMBERS / 4, QUERY_SCALE = 1, SUM_SHIFT = 0 };

// Where number 0 to 3 of a column lies in a vector of bytes: the first two of all columns come
// before the last two, so that sums of four products form in words of their own.
static inline int byte_place(int lane, int number)
{
    return number / 2 * 8 + lane * 2 + number % 2;
}

static inline Words reference_step(const int8_t *block, int step, int half)
{
    return *(const WordsAnywhere *)(block + (2 * step + half) * 4 * LANES);
}

static inline QueryStep query_step(const QueryNumber *row, int step)
{
    int16_t two[2];
    memcpy(two, row + 4 * step, sizeof two);
    return (QueryStep){(int8x16_t)vdupq_n_s16(two[0]), (int8x16_t)vdupq_n_s16(two[1])};
}

static inline Words dot(Words sum, Words reference, QueryStep query)
{
    int8x16_t bytes = (int8x16_t)reference;
    int16x8_t twos = vmull_s8(vget_low_s8(bytes), vget_low_s8(query.lower));
    twos = vmlal_high_s8(twos, bytes, query.upper);
    return (Words)vpadalq_s16((int32x4_t)sum, twos);
}

static inline Words beginning(int32_t start, int32_t label)
{
    (void)start, (void)label;
    return splat(0);
}

#include "kernels.h"
#endif
