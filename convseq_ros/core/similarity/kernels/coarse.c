// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Coarse scores: products of many rows of numbers in half precision with one vector.

enum {
    ABREAST = 4, // rows at a time: what waits for one sum adds to another
    AHEAD = 8192, // bytes that memory is asked for before they are needed
};

// Add 16 products to 16 sums, of numbers that the mask lets through.
static inline void add_products(const uint16_t *row, const float *direction,
                                const Words *mask, Floats *sums)
{
    for (int part = 0; part < 16 / LANES; part++) {
        Floats numbers = widened(row + part * LANES);
        if (mask)
            numbers = (Floats)((Words)numbers & mask[part]);
        sums[part] = fused(numbers, floats(direction + part * LANES), sums[part]);
    }
}

// Write the products of rows [count][numbers] in half precision with one vector, which has zeros
// behind it up to a multiple of 16. All processors add alike, to 16 sums.
KERNEL(products)(const uint16_t *rows, intptr_t count, intptr_t numbers, const float *direction,
                 float *products)
{
    intptr_t whole = numbers / 16 * 16;
    Words mask[16 / LANES]; // what lies behind a row are numbers of the next, or none
    for (intptr_t lane = 0; lane < 16; lane++)
        mask[lane / LANES][lane % LANES] = whole + lane < numbers ? -1 : 0;
    intptr_t row = 0;
    for (; row + ABREAST < count; row += ABREAST) {
        const uint16_t *own = rows + row * numbers;
        Floats sums[ABREAST][16 / LANES] = {0};
        for (intptr_t byte = 0; byte < 2 * ABREAST * numbers; byte += 64)
            __builtin_prefetch((const char *)own + AHEAD + byte);
        for (intptr_t first = 0; first < whole; first += 16)
#pragma GCC unroll 4
            for (int beside = 0; beside < ABREAST; beside++)
                add_products(own + beside * numbers + first, direction + first, 0, sums[beside]);
#pragma GCC unroll 4
        for (int beside = 0; beside < ABREAST; beside++) {
            if (whole < numbers)
                add_products(own + beside * numbers + whole, direction + whole, mask,
                             sums[beside]);
            products[row + beside] = added_up(sums[beside], 16 / LANES);
        }
    }
    for (; row < count; row++) { // behind the last row there may be no memory of ours
        Floats sums[16 / LANES] = {0};
        uint16_t last[16] = {0};
        for (intptr_t first = 0; first < whole; first += 16)
            add_products(rows + row * numbers + first, direction + first, 0, sums);
        memcpy(last, rows + row * numbers + whole, (size_t)(numbers - whole) * sizeof *last);
        if (whole < numbers)
            add_products(last, direction + whole, 0, sums);
        products[row] = added_up(sums, 16 / LANES);
    }
    return 0;
}

// Return 0 if dot products of bytes, and sums of products in single and half precision, are right.
KERNEL(probe)(void)
{
    uint16_t halves[16];
    float direction[16], product = 0;
    // Bytes 1 and 2 again and again, wherever a layout has a region's four.
    int32_t dots = 0, expected = QUERY_SCALE > 1 ? 0x201 * (1 + 2) : 1 + 2 * 2 + 3 + 2 * 4;
    for (int number = 0; number < 16; number++)
        halves[number] = 0x3c00, direction[number] = (float)number; // ones
    CALL(peak)(1, &dots);
    CALL(products)(halves, 1, 16, direction, &product);
    return dots != 12 * expected || product != 120;
}
