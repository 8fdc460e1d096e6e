// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX2 and FMA: Intel since Haswell, AMD since Zen.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c")
#include <immintrin.h>
#define VARIANT avx2
#include "avx2.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return sum + (Words)_mm256_madd_epi16((__m256i)reference, (__m256i)query);
}

static inline Words raised(const int8_t *bytes, int upper)
{
    __m256i zero = _mm256_setzero_si256(), all = _mm256_loadu_si256((const __m256i *)bytes);
    return (Words)(upper ? _mm256_unpackhi_epi8(zero, all) : _mm256_unpacklo_epi8(zero, all));
}

#include "pairs.h"
#include "kernels.h"
#endif
