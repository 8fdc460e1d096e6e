// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Vectors of LANES 32-bit numbers, which GCC turns into instructions; and the layout of bytes for
// their dot products, which GCC does not provide.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#define REGISTER "+x" // of vectors
#else
#include <arm_neon.h>
#define REGISTER "+w"
#endif

#define INLINE static inline __attribute__((always_inline))

typedef float Floats __attribute__((vector_size(4 * LANES)));
typedef int32_t Words __attribute__((vector_size(4 * LANES)));
typedef int16_t Shorts __attribute__((vector_size(2 * LANES)));
typedef double Doubles __attribute__((vector_size(4 * LANES)));
typedef int64_t Longs __attribute__((vector_size(4 * LANES)));
typedef Floats FloatsAnywhere __attribute__((aligned(4), may_alias));
typedef Doubles DoublesAnywhere __attribute__((aligned(8), may_alias));
typedef Words WordsAnywhere __attribute__((aligned(4), may_alias));
typedef Shorts ShortsAnywhere __attribute__((aligned(2), may_alias));

enum {
    COLUMNS = 2 * LANES, // regions of a reference that are compared at once
    NUMBERS = 32, // of a region
    STEPS = NUMBERS / 4, // of a dot product of bytes, four at a time
    LABEL_BITS = 15, // below a dot product of bytes in one word: where it was found
    LABEL = (1 << LABEL_BITS) - 1,
};

static inline Words splat(int32_t value) { return value - (Words){}; }
static inline Floats spread(float value) { return value - (Floats){}; }
static inline Words words(const int32_t *from) { return *(const WordsAnywhere *)from; }
static inline Floats floats(const float *from) { return *(const FloatsAnywhere *)from; }
static inline Doubles doubles(const double *from) { return *(const DoublesAnywhere *)from; }
static inline void store(float *to, Floats values) { *(FloatsAnywhere *)to = values; }
static inline Words chosen(Words mask, Words yes, Words no) { return (mask & yes) | (~mask & no); }

static inline Words larger(Words one, Words other)
{
#if defined(__AVX512F__)
    return (Words)_mm512_max_epi32((__m512i)one, (__m512i)other);
#elif defined(__AVX2__)
    return (Words)_mm256_max_epi32((__m256i)one, (__m256i)other);
#else
    return (Words)vmaxq_s32((int32x4_t)one, (int32x4_t)other);
#endif
}

// Keep a number and its label where it is larger than the best so far.
static inline void keep_larger(Floats number, Words label, Floats *best, Words *labels)
{
#if defined(__AVX512F__)
    __mmask16 better = _mm512_cmp_ps_mask((__m512)number, (__m512)*best, _CMP_GT_OQ);
    *labels = (Words)_mm512_mask_mov_epi32((__m512i)*labels, better, (__m512i)label);
    *best = (Floats)_mm512_mask_mov_ps((__m512)*best, better, (__m512)number);
#else
    Words better = number > *best;
    *labels = chosen(better, label, *labels);
    *best = (Floats)chosen(better, (Words)number, (Words)*best);
#endif
}

// Add a product to a sum, rounded once.
static inline Floats fused(Floats one, Floats other, Floats sum)
{
#if defined(__AVX512F__)
    return (Floats)_mm512_fmadd_ps((__m512)one, (__m512)other, (__m512)sum);
#elif defined(__FMA__)
    return (Floats)_mm256_fmadd_ps((__m256)one, (__m256)other, (__m256)sum);
#else
    return (Floats)vfmaq_f32((float32x4_t)sum, (float32x4_t)one, (float32x4_t)other);
#endif
}

// Lane indices for rotating a vector: LANES from any start on; a shuffle takes them modulo LANES.
static const int32_t TURNED[32] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                                   16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

// Sum the numbers of a vector: the upper half is added to the lower one, and so on, for any width.
static inline float added_up(Floats *sums, int vectors)
{
    for (int half = vectors / 2; half; half /= 2)
        for (int part = 0; part < half; part++)
            sums[part] += sums[part + half];
#pragma GCC unroll 4
    for (int half = LANES / 2; half; half /= 2)
        sums[0] += __builtin_shuffle(sums[0], *(const WordsAnywhere *)(TURNED + half));
    return sums[0][0];
}

// Return the largest of a vector's numbers.
static inline int32_t largest(Words words)
{
#pragma GCC unroll 4
    for (int half = LANES / 2; half; half /= 2)
        words = larger(words, __builtin_shuffle(words, *(const WordsAnywhere *)(TURNED + half)));
    return words[0];
}

// Return numbers in half precision as floats.
static inline Floats widened(const uint16_t *halves)
{
#if defined(__AVX512F__)
    return (Floats)_mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)halves));
#elif defined(__F16C__)
    return (Floats)_mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)halves));
#else
    // The bits of a half, shifted to their position in a float, are too small by 2 ** 112.
    Words bits = __builtin_convertvector(*(const ShortsAnywhere *)halves, Words);
    return (Floats)(bits << 13 & splat((int32_t)0x8fffe000)) * 0x1p112f;
#endif
}

// Return a sum with its label in the low bits.
static inline Words labelled(Words sum, int32_t label)
{
#if defined(__AVX512VBMI2__)
    __m512i top = (__m512i)(splat(label) << (32 - LABEL_BITS));
    return (Words)_mm512_shldi_epi32((__m512i)sum, top, LABEL_BITS);
#elif defined(__aarch64__)
    return (Words)vsliq_n_s32(vdupq_n_s32(label), (int32x4_t)sum, LABEL_BITS);
#else
    return sum << LABEL_BITS | splat(label);
#endif
}

// Return a query's value for a step, in all lanes.
#ifdef __x86_64__
typedef Words QueryStep;

static inline QueryStep query_step(const int8_t *row, int step)
{
    int32_t word;
    memcpy(&word, row + 4 * step, sizeof word);
    return splat(word);
}
#endif

// Return the values of half a block of a reference for a step.
static inline Words reference_step(const int8_t *block, int step, int half)
{
    return *(const WordsAnywhere *)(block + (2 * step + half) * 4 * LANES);
}

// Return the position of byte 0 to 3 of a column in a vector: contiguous, or in pairs, with those
// of four columns together, as unpacking needs them.
static inline int byte_place(int lane, int number)
{
#ifdef WIDENED
    return lane / 4 * 16 + number / 2 * 8 + lane % 4 * 2 + number % 2;
#else
    return 4 * lane + number;
#endif
}
