// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX2 and FMA: Intel since Haswell, AMD since Zen.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c")
#define VARIANT avx2
#define LANES 8
#define ROWS 6
#define SMALL_SUMS // dot products of unit vectors are added up in 16 bits; see labelled_dots
#include "vectors.h"

// Return products of a query's bytes with a reference's, two and two, in 16 bits: one of both has
// to be without signs.
static inline Words twos(Words reference, Words query)
{
    __m256i turned = _mm256_sign_epi8((__m256i)query, (__m256i)reference);
    return (Words)_mm256_maddubs_epi16(_mm256_abs_epi8((__m256i)reference), turned);
}

static inline Words add_twos(Words sum, Words reference, Words query)
{
    sum = (Words)_mm256_add_epi16((__m256i)sum, (__m256i)twos(reference, query));
    __asm__("" : REGISTER(sum)); // else the compiler adds later, and runs out of registers
    return sum;
}

// Return the sums of two and two numbers of 16 bits, so many times.
static inline Words added(Words sums, int16_t times)
{
    return (Words)_mm256_madd_epi16((__m256i)sums, _mm256_set1_epi16(times));
}

static inline Words dot(Words sum, Words reference, Words query)
{
    return sum + added(twos(reference, query), 1);
}

#include "kernels.h"
#endif
