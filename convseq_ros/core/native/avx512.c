// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX-512 with VNNI and VBMI2: Intel since Ice Lake, AMD since Zen 4.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi2")
#pragma GCC target("prefer-vector-width=512")
#include <immintrin.h>
#define VARIANT avx512
#define LANES 16
#define ROWS 12
#define MASKED // comparisons have a type of their own
#include "vectors.h"

static inline Floats fused(Floats one, Floats other, Floats sum)
{
    return (Floats)_mm512_fmadd_ps((__m512)one, (__m512)other, (__m512)sum);
}

static inline Words larger(Words one, Words other)
{
    return (Words)_mm512_max_epi32((__m512i)one, (__m512i)other);
}

typedef __mmask16 Mask;

static inline Mask above(Words one, Words other)
{
    return _mm512_cmpgt_epi32_mask((__m512i)one, (__m512i)other);
}

static inline Mask more(Floats one, Floats other)
{
    return _mm512_cmp_ps_mask((__m512)one, (__m512)other, _CMP_GT_OQ);
}

static inline Words chosen(Mask mask, Words yes, Words no)
{
    return (Words)_mm512_mask_blend_epi32(mask, (__m512i)no, (__m512i)yes);
}

static inline Floats widened(const uint16_t *halves)
{
    return (Floats)_mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)halves));
}

#define OFFSET 128 // the reference's bytes are unsigned
#define LABEL_SHIFT (32 - LABEL_BITS) // labels are shifted in from the top of a word
#include "quads.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return (Words)_mm512_dpbusd_epi32((__m512i)sum, (__m512i)reference, (__m512i)query);
}

static inline Words labelled(Words sum, int32_t label)
{
    return (Words)_mm512_shldi_epi32((__m512i)sum, _mm512_set1_epi32(label), LABEL_BITS);
}

#include "kernels.h"
#endif
