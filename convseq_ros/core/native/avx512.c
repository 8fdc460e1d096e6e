// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX-512 with VNNI and VBMI2: Intel since Ice Lake, AMD since Zen 4.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi2")
#pragma GCC target("prefer-vector-width=512")
#define VARIANT avx512
#define LANES 16
#define ROWS 8
#define OFFSET 128 // dot products take a reference's bytes as unsigned
#include "vectors.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return (Words)_mm512_dpbusd_epi32((__m512i)sum, (__m512i)reference, (__m512i)query);
}

#include "kernels.h"
#endif
