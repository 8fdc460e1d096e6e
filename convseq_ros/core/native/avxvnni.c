// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// AVX2 with VNNI: Intel's small and desktop processors since Alder Lake, AMD since Zen 5.
#ifdef __x86_64__
#pragma GCC target("avx2,fma,f16c,avxvnni")
#define VARIANT avxvnni
#define LANES 8
#define ROWS 6
#define OFFSET 128 // dot products take a reference's bytes as unsigned
#include "vectors.h"

static inline Words dot(Words sum, Words reference, Words query)
{
    return (Words)_mm256_dpbusd_avx_epi32((__m256i)sum, (__m256i)reference, (__m256i)query);
}

#include "kernels.h"
#endif
