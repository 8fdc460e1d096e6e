// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What all processors with AVX2 share; 256-bit vectors.
#define LANES 8
#define ROWS 6
#include "vectors.h"

static inline Floats fused(Floats one, Floats other, Floats sum)
{
    return (Floats)_mm256_fmadd_ps((__m256)one, (__m256)other, (__m256)sum);
}

static inline Words larger(Words one, Words other)
{
    return (Words)_mm256_max_epi32((__m256i)one, (__m256i)other);
}

static inline Words chosen(Words mask, Words yes, Words no)
{
    return (Words)_mm256_blendv_epi8((__m256i)no, (__m256i)yes, (__m256i)mask);
}

static inline Floats widened(const uint16_t *halves)
{
    return (Floats)_mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)halves));
}
