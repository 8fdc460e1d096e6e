// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// SSE4.1: every x86-64 processor since 2008, such as Intel's Atoms. It has no fused products.
#ifdef __x86_64__
#pragma GCC target("sse4.1")
#define VARIANT sse4
#define LANES 4
#define ROWS 6
#define PAIRS
#include "vectors.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return sum + (Words)_mm_madd_epi16((__m128i)reference, (__m128i)query);
}

static inline Words raised(Words bytes, int upper)
{
    __m128i zero = _mm_setzero_si128();
    return (Words)(upper ? _mm_unpackhi_epi8(zero, (__m128i)bytes)
                         : _mm_unpacklo_epi8(zero, (__m128i)bytes));
}

#include "kernels.h"
#endif
