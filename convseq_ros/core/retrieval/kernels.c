// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Coarse scores: products of many half-precision rows with a vector.

enum {
    ABREAST = 4, // rows at a time: what waits for one sum adds to another
    AHEAD = 2048, // bytes that memory is asked for before they are needed
};

// Add 16 products to 16 sums.
static inline void add_products(const uint16_t *row, const float *direction, Floats *sums)
{
    for (int part = 0; part < 16 / LANES; part++)
        sums[part] = fused(widened(row + part * LANES), floats(direction + part * LANES),
                           sums[part]);
}

// Write the products of `count` rows with a vector. All processors use the same 16 sums.
INLINE void multiply(const uint16_t *rows, int count, intptr_t numbers, const float *direction,
                     float *products)
{
    Floats sums[ABREAST][16 / LANES] = {0};
    for (intptr_t first = 0; first < numbers; first += 16)
#pragma GCC unroll 4
        for (int row = 0; row < count; row++)
            add_products(rows + row * numbers + first, direction + first, sums[row]);
#pragma GCC unroll 4
    for (int row = 0; row < count; row++)
        products[row] = added_up(sums[row], 16 / LANES);
}

// Write the products of half-precision rows [count][numbers] with a vector, which is padded with
// zeros to a multiple of 16, so that numbers after a row do not count.
KERNEL(products)(const uint16_t *rows, intptr_t count, intptr_t numbers, const float *direction,
                 float *products)
{
    uint16_t *last = calloc((size_t)rounded_up(numbers, 16), sizeof *last);
    intptr_t row = 0;
    for (; (row + ABREAST - count) * numbers + 16 <= 0 && last; row += ABREAST) {
        const uint16_t *own = rows + row * numbers;
        for (intptr_t byte = 0; byte < 2 * ABREAST * numbers; byte += 64)
            __builtin_prefetch((const char *)own + AHEAD + byte);
        multiply(own, ABREAST, numbers, direction, products + row);
    }
    for (; row < count && last; row++) { // behind the last rows there may be no memory of ours
        memcpy(last, rows + row * numbers, (size_t)numbers * sizeof *last);
        multiply(last, 1, numbers, direction, products + row);
    }
    free(last);
    return last ? 0 : -1;
}

// Return 0 if dot products of bytes, and sums of products in single and half precision, are right.
KERNEL(probe)(void)
{
    uint16_t halves[16];
    float direction[16], product = 0;
    // Alternating bytes 1 and 2, so that the layout of a region's four bytes does not matter.
    int32_t dots = 0, expected = 1 + 2 * 2 + 3 + 2 * 4;
    for (int number = 0; number < 16; number++)
        halves[number] = 0x3c00, direction[number] = (float)number; // ones
    CALL(peak)(1, &dots);
    CALL(products)(halves, 1, 16, direction, &product);
    return dots != 12 * expected || product != 120;
}
