// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Bytes for instructions that add the products of two numbers of 16 bits to each word. A
// reference's are taken 256 times, a query's 128 times: dot products lie above their labels.
typedef int16_t QueryNumber;
typedef Words QueryStep;
enum { OFFSET = 0, STEPS = NUMBERS / 2, QUERY_SCALE = 128, SUM_SHIFT = LABEL_BITS };

// Where number 0 to 3 of a column lies in a vector of bytes: in halves of 16, as they unpack.
static inline int byte_place(int lane, int number)
{
    return lane / 4 * 16 + number / 2 * 8 + lane % 4 * 2 + number % 2;
}

static inline Words reference_step(const int8_t *block, int step, int half)
{
    return raised(block + (step / 2 * 2 + half) * 4 * LANES, step % 2);
}

static inline QueryStep query_step(const QueryNumber *row, int step)
{
    int32_t two;
    memcpy(&two, row + 2 * step, sizeof two);
    return splat(two);
}

static inline Words beginning(int32_t start, int32_t label)
{
    (void)start;
    return splat(label);
}

static inline Words labelled(Words sum, int32_t label)
{
    (void)label;
    return sum;
}
