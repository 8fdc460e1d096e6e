// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Vectors of LANES numbers of 32 bits, and how those of a reference lie in memory.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef float Floats __attribute__((vector_size(4 * LANES)));
typedef int32_t Words __attribute__((vector_size(4 * LANES)));
typedef Floats FloatsAnywhere __attribute__((aligned(4), may_alias));
typedef Words WordsAnywhere __attribute__((aligned(4), may_alias));

#ifdef __x86_64__
#define VECTOR_REGISTER "v"
#else
#define VECTOR_REGISTER "w"
#endif

enum {
    COLUMNS = 2 * LANES, // regions of a reference that are compared at once
    NUMBERS = 32, // of a region
    LABEL_BITS = 15, // below a dot product of bytes in one word: where it was found
    LABEL = (1 << LABEL_BITS) - 1,
    ROW_BIT = 11, // a label is a row in a tile, from this bit on, and a vector of the reference
    VECTOR = (1 << ROW_BIT) - 1,
};

static inline Words splat(int32_t value)
{
    return value - (Words){};
}

static inline Floats spread(float value)
{
    return value - (Floats){};
}

static inline Floats floats(const float *from)
{
    return *(const FloatsAnywhere *)from;
}

static inline void store(float *to, Floats values)
{
    *(FloatsAnywhere *)to = values;
}

#ifndef MASKED
typedef Words Mask; // where a comparison holds

static inline Mask above(Words one, Words other)
{
    return one > other;
}

static inline Mask more(Floats one, Floats other)
{
    return one > other;
}
#endif
