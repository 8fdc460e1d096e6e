// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What is done to cells and regions before they are compared.

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
// square blocks, [blocks][blocks][32], in whole numbers, whose products are exact in any order.
// Without `sums` none are added up.
KERNEL(subtract)(float *regions, const float *background, intptr_t side, intptr_t block,
                      float *sums)
{
    intptr_t blocks = sums ? (side + block - 1) / block : 0;
    for (intptr_t place = 0; place < side * side; place++) {
        float *own = regions + place * NUMBERS;
        place_region(own, 1, background + place * NUMBERS, own);
        if (!sums)
            continue;
        float *sum = sums + (place / side / block * blocks + place % side / block) * NUMBERS;
        for (int number = 0; number < NUMBERS; number++)
            sum[number] += own[number];
    }
    for (intptr_t place = 0; place < blocks * blocks * NUMBERS && sums; place++)
        sums[place] = rintf(sums[place] * 0x1p17f); // as GLOBAL_SIMILARITY has it
    return 0;
}
