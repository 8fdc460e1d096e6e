// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Bytes for instructions that add the products of four bytes to each word.
typedef int8_t QueryNumber;
typedef Words QueryStep;
enum { STEPS = NUMBERS / 4, QUERY_SCALE = 1, SUM_SHIFT = 0 };

// Where number 0 to 3 of a column lies in a vector of bytes.
static inline int byte_place(int lane, int number)
{
    return 4 * lane + number;
}

static inline Words reference_step(const int8_t *block, int step, int half)
{
    return *(const WordsAnywhere *)(block + (2 * step + half) * 4 * LANES);
}

static inline QueryStep query_step(const QueryNumber *row, int step)
{
    int32_t four;
    memcpy(&four, row + 4 * step, sizeof four);
    return splat(four);
}

// What a sum begins with, given what the offset of the reference's bytes adds to it.
static inline Words beginning(int32_t start, int32_t label)
{
    (void)label;
    return splat(start);
}
