// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// All kernels; they return 0, or -1 if there is no memory.
#define JOIN(name, variant) convseq_##name##_##variant
#define NAMED(name, variant) JOIN(name, variant)
#define SHOWN __attribute__((visibility("default"))) // to who loads the library
#define CALL(name) NAMED(name, VARIANT) // from another kernel
#define KERNEL(name) SHOWN int CALL(name)
#ifdef OFFSET
// Add the products of four bytes in a word with those in another word. One operand is unsigned; the
// initial values of sums compensate for that.
typedef Words Sums;
static inline Sums begun(const int32_t *start) { return words(start); }
static inline Words whole(Sums sum) { return sum; }
static inline Sums add_fours(Sums sum, Words one, Words other)
{
    return dot(sum, one ^ splat((int32_t)0x80808080), other);
}
#else
#define OFFSET 0
#endif

#include "../encoding/kernels.c"
#include "../similarity/kernels/tile.c"
#include "../similarity/kernels/coherent.c"
#include "../similarity/kernels/references.c"
#include "../retrieval/kernels.c"
#include "../geometry/kernels.c"
