// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Tiles of dot products: ROWS regions of a query by two vectors of a reference's, COLUMNS. All
// sums stay in registers while the numbers of the regions stream by.
//
// The layout of a query is [rows][numbers], of a reference [blocks][numbers][COLUMNS], or
// [blocks][numbers / 4][2][4 * LANES] for bytes. Both are padded by repeating the last region.
#ifdef SMALL_SUMS
#define START(start) 0 // a reference's bytes have no offset
#define ADDED 0
#else
#define START(start) (start)
#define ADDED OFFSET

static inline Words add_twos(Words sum, Words reference, QueryStep query)
{
    return dot(sum, reference, query);
}
#endif

// Write dot products of bytes; with SMALL_SUMS, as sums of two numbers of 16 bits: the lengths of a
// query's and a reference's bytes have a product below 2 ** 15, so all sums are below it, in any
// order. `start`: initial values of sums, which compensate the offset of a reference's bytes.
INLINE void raw_dots(const int8_t *query, const int8_t *block, const int32_t *start,
                     Words sums[ROWS][2])
{
    (void)start;
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++)
        sums[row][0] = sums[row][1] = splat(START(start[row]));
    // Otherwise the compiler keeps the address of every number, and runs out of registers.
    __asm__("" : "+r"(query));
#pragma GCC unroll 8
    for (int step = 0; step < STEPS; step++) {
        Words left = reference_step(block, step, 0), right = reference_step(block, step, 1);
#pragma GCC unroll 16
        for (int row = 0; row < ROWS; row++) {
            QueryStep own = query_step(query + row * NUMBERS, step);
            sums[row][0] = add_twos(sums[row][0], left, own);
            sums[row][1] = add_twos(sums[row][1], right, own);
        }
    }
}

// The same, with labels in the low bits.
INLINE void labelled_dots(const int8_t *query, const int8_t *block, const int32_t *start,
                          const int32_t *labels, Words words[ROWS][2])
{
    raw_dots(query, block, start, words);
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++)
        for (int half = 0; half < 2; half++)
#ifdef SMALL_SUMS // 2 ** 15 is too large for 16 bits, its negative not
            words[row][half] = splat(labels[row + half]) - added(words[row][half], INT16_MIN);
#else
            words[row][half] = labelled(words[row][half], labels[row + half]);
#endif
}

static inline intptr_t rounded_up(intptr_t count, intptr_t step)
{
    return (count + step - 1) / step * step;
}

// Regions of a query and of a reference in a tile; the offset that is added to a reference's bytes.
SHOWN const int32_t CALL(shape)[] = {ROWS, COLUMNS, ADDED};

// Lay out the regions [count][32] of a reference as bytes, with an offset that sums compensate.
KERNEL(pack_reference)(const float *regions, intptr_t count, float scale, int8_t *packed)
{
    for (intptr_t place = 0; place < rounded_up(count, COLUMNS); place++) {
        const float *own = regions + (place < count ? place : count - 1) * NUMBERS;
        int8_t *vectors = packed + place / COLUMNS * COLUMNS * NUMBERS;
        int half = place % COLUMNS / LANES, lane = place % LANES;
        int8_t bytes[NUMBERS];
        for (int number = 0; number < NUMBERS; number++) {
            float whole = rintf(own[number] * scale);
            whole = whole > 127 ? 127 : whole < -127 ? -127 : whole;
            bytes[number] = (int8_t)((int)whole + ADDED);
        }
        for (int four = 0; four < NUMBERS / 4; four++)
            for (int two = 0; two < 4; two += 2) // which lie beside each other in all layouts
                memcpy(vectors + (four * 2 + half) * 4 * LANES + byte_place(lane, two),
                       bytes + 4 * four + two, 2);
    }
    return 0;
}

// Write the regions [count][32] of a reference that is laid out as bytes, times a scale.
KERNEL(unpack_reference)(const int8_t *packed, intptr_t count, float scale, float *regions)
{
    for (intptr_t place = 0; place < count; place++) {
        int half = place % COLUMNS / LANES, lane = place % LANES;
        const int8_t *own = packed + place / COLUMNS * COLUMNS * NUMBERS + half * 4 * LANES;
        for (int number = 0; number < NUMBERS; number++) {
            int8_t byte = own[number / 4 * 8 * LANES + byte_place(lane, number % 4)];
            regions[place * NUMBERS + number] = scale * (float)(int8_t)(byte - ADDED);
        }
    }
    return 0;
}

// Add dot products in registers only, 12 in every loop: the highest rate of the processor.
KERNEL(peak)(intptr_t loops, int32_t *found)
{
    int8_t numbers[NUMBERS] = {1, 2, 3, 4};
    Words sums[12] = {0}, reference = splat(0x02010201);
    QueryStep query = query_step(numbers, 0);
    for (intptr_t loop = 0; loop < loops; loop++)
#pragma GCC unroll 12
        for (int one = 0; one < 12; one++) {
            __asm__ volatile("" : REGISTER(reference)); // keeps every product
            sums[one] = add_twos(sums[one], reference, query);
        }
    for (int one = 1; one < 12; one++)
        sums[0] += sums[one];
#ifdef SMALL_SUMS
    sums[0] = added(sums[0], 1);
#endif
    *found = sums[0][0];
    return 0;
}
