// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What all 64-bit ARM processors share; 128-bit vectors, 32 of them.
#include <arm_neon.h>
#define LANES 4
#define ROWS 12
#include "vectors.h"

static inline Floats fused(Floats one, Floats other, Floats sum)
{
    return (Floats)vfmaq_f32((float32x4_t)sum, (float32x4_t)one, (float32x4_t)other);
}

static inline Words larger(Words one, Words other)
{
    return (Words)vmaxq_s32((int32x4_t)one, (int32x4_t)other);
}

static inline Words chosen(Words mask, Words yes, Words no)
{
    return (Words)vbslq_s32((uint32x4_t)mask, (int32x4_t)yes, (int32x4_t)no);
}

static inline Floats widened(const uint16_t *halves)
{
    return (Floats)vcvt_f32_f16(vreinterpret_f16_u16(vld1_u16(halves)));
}

static inline Words labelled(Words sum, int32_t label)
{
    return (Words)vsliq_n_s32(vdupq_n_s32(label), (int32x4_t)sum, LABEL_BITS);
}
