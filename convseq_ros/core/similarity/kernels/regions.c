// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What is done to cells and regions before they are compared, and coarse scores.

// Fill in the normalised cells [size][size][8]; see `normalized`. Return 0, or -1 if there is no
// memory. typical: means of the image at which a number counts half.
KERNEL(normalize)(const float *cells, intptr_t size, float middle, float side,
                      double typical, float *found)
{
    intptr_t line = size * BINS, count = size * line;
    float *above = malloc((size_t)(2 * count) * sizeof *above), *across = above + count;
    for (intptr_t cell = 0; cell < size * size && above; cell++) {
        const float *own = cells + cell * BINS;
        float lowest = own[0];
        for (int bin = 1; bin < BINS; bin++)
            lowest = own[bin] < lowest ? own[bin] : lowest;
        for (int bin = 0; bin < BINS; bin++)
            above[cell * BINS + bin] = own[bin] - lowest;
    }
    for (intptr_t cell = 0; cell < size * size && above; cell++) {
        intptr_t column = cell % size;
        const float *own = above + cell * BINS;
        const float *left = own - (column > 0 ? BINS : 0);
        const float *right = own + (column < size - 1 ? BINS : 0);
        for (int bin = 0; bin < BINS; bin++)
            across[cell * BINS + bin] = middle * own[bin] + side * (left[bin] + right[bin]);
    }
    double total = 0;
    for (intptr_t cell = 0; cell < size * size && above; cell++) {
        const float *own = across + cell * BINS;
        const float *upper = own - (cell >= size ? line : 0);
        const float *lower = own + (cell < count / BINS - size ? line : 0);
        float here = 0;
        for (int bin = 0; bin < BINS; bin++) {
            float number = middle * own[bin] + side * (upper[bin] + lower[bin]);
            found[cell * BINS + bin] = number;
            here += number;
        }
        total += here;
    }
    float half = (float)(typical * total / (double)count);
    for (intptr_t place = 0; place < count && above && half > 0; place++)
        found[place] /= found[place] + half;
    free(above);
    return above ? 0 : -1;
}

// Subtract the background from regions [side * side][32], to unit length, and add them up in
// square blocks, [blocks][blocks][32].
KERNEL(subtract)(float *regions, const float *background, intptr_t side, intptr_t block,
                      float *sums)
{
    intptr_t blocks = (side + block - 1) / block;
    for (intptr_t place = 0; place < side * side; place++) {
        float *own = regions + place * NUMBERS;
        float *sum = sums + (place / side / block * blocks + place % side / block) * NUMBERS;
        place_region(own, 1, background + place * NUMBERS, own);
        for (int number = 0; number < NUMBERS; number++)
            sum[number] += own[number];
    }
    return 0;
}

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

// Add up 16 sums: the upper half to the lower one, and so on, in vectors of any width.
static inline float added_up(Floats *sums)
{
    for (int half = 8 / LANES; half; half /= 2)
        for (int part = 0; part < half; part++)
            sums[part] += sums[part + half];
#pragma GCC unroll 4
    for (int half = LANES / 2; half; half /= 2) {
        Words upper;
#pragma GCC unroll 16
        for (int lane = 0; lane < LANES; lane++)
            upper[lane] = (lane + half) % LANES;
        sums[0] += __builtin_shuffle(sums[0], upper);
    }
    return sums[0][0];
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
            products[row + beside] = added_up(sums[beside]);
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
        products[row] = added_up(sums);
    }
    return 0;
}
