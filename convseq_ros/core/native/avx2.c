// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX2 and FMA: Intel since Haswell, AMD since Zen.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c")
#define VARIANT avx2
#define LANES 8
#define ROWS 6
#define SMALL_SUMS // dot products of bytes are added up in 16 bits; see raw_dots
#include "vectors.h"

// Add products of a query's bytes with a reference's in pairs, in 16 bits. One operand must be
// unsigned.
static inline Words add_twos(Words sum, Words reference, Words query)
{
    query = (Words)_mm256_sign_epi8((__m256i)query, (__m256i)reference);
    reference = (Words)_mm256_abs_epi8((__m256i)reference);
    __m256i twos = _mm256_maddubs_epi16((__m256i)reference, (__m256i)query);
    sum = (Words)_mm256_add_epi16((__m256i)sum, twos);
    __asm__("" : REGISTER(sum)); // else the compiler adds later, and runs out of registers
    return sum;
}

// Return the sums of pairs of 16-bit numbers, multiplied by a factor.
static inline Words added(Words sums, int16_t times)
{
    return (Words)_mm256_madd_epi16((__m256i)sums, _mm256_set1_epi16(times));
}

// Add the products of four bytes in a word with those in another word, in pairs.
typedef Words Sums;
static inline Sums begun(const int32_t *start) { return (void)start, splat(0); }
static inline Words whole(Sums sum) { return added(sum, 1); }
static inline Sums add_fours(Sums sum, Words one, Words other)
{
    return add_twos(sum, one, other);
}

#include "kernels.h"
#endif
