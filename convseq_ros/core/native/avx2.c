// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX2 and FMA: Intel since Haswell, AMD since Zen.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c")
#define VARIANT avx2
#define LANES 8
#define ROWS 6
#define PAIRS
#include "vectors.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return sum + (Words)_mm256_madd_epi16((__m256i)reference, (__m256i)query);
}

static inline Words raised(Words bytes, int upper)
{
    __m256i zero = _mm256_setzero_si256();
    return (Words)(upper ? _mm256_unpackhi_epi8(zero, (__m256i)bytes)
                         : _mm256_unpacklo_epi8(zero, (__m256i)bytes));
}

#include "kernels.h"
#endif
