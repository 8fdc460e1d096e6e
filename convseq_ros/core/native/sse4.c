// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// SSE4.1: every x86-64 processor since 2008, such as Intel's Atoms; multiplies and adds in turn.
#ifdef __x86_64__
#pragma GCC target("sse4.1")
#include <immintrin.h>
#define VARIANT sse4
#define LANES 4
#define ROWS 6
#include "vectors.h"

static inline Floats fused(Floats one, Floats other, Floats sum)
{
    return one * other + sum;
}

static inline Words larger(Words one, Words other)
{
    return (Words)_mm_max_epi32((__m128i)one, (__m128i)other);
}

static inline Words chosen(Words mask, Words yes, Words no)
{
    return (Words)_mm_blendv_epi8((__m128i)no, (__m128i)yes, (__m128i)mask);
}

static inline Floats widened(const uint16_t *halves)
{
    // A half's bits, moved to where a float has them, are a number too small by 2 ** 112.
    Words bits = (Words)_mm_cvtepi16_epi32(_mm_loadl_epi64((const __m128i *)halves));
    return (Floats)(bits << 13 & splat((int32_t)0x8fffe000)) * 0x1p112f;
}

static inline Words dot(Words sum, Words reference, Words query)
{
    return sum + (Words)_mm_madd_epi16((__m128i)reference, (__m128i)query);
}

static inline Words raised(const int8_t *bytes, int upper)
{
    __m128i zero = _mm_setzero_si128(), all = _mm_loadu_si128((const __m128i *)bytes);
    return (Words)(upper ? _mm_unpackhi_epi8(zero, all) : _mm_unpacklo_epi8(zero, all));
}

#include "pairs.h"
#include "kernels.h"
#endif
