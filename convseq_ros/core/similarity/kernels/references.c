// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// References, from their packed cells to their features, and their global similarities.

// Fill in the normalised cells [size][size][8]; see `normalized`. Return 0, or -1 if there is no
// memory. typical: the number, in means of the image, that becomes 0.5.
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

// Subtract the background from regions [side * side][32], scale them to unit length, and sum them
// over square blocks, [blocks][blocks][32], as integers, whose products are exact in any order.
// Without `sums` there are no blocks.
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

// Compute the features of references, in panels; shown: 0 for a reference without gradient.
//
// packed: cells [size][size][8] of each in half precision, to be multiplied by `unit` and
// normalised (see there). The background is subtracted if there is one. A panel has the regions of
// every `step`-th row and column in `room` bytes, followed by the sums of blocks of all regions, if
// `block` and a background are given.
KERNEL(prepare)(const uint16_t *const *packed, intptr_t several, intptr_t size, int step,
                float unit, float middle, float beside, double typical, const float *axes,
                const float *origin, const float *background, intptr_t block, float scale,
                intptr_t room, int8_t *const *panels, int8_t *shown)
{
    intptr_t side = (size - SPAN) / step + 1, count = side * side, numbers = size * size * BINS;
    intptr_t blocks = block ? (side + block - 1) / block : 0;
    // Cells, normalised cells, and regions.
    float *cells = malloc((size_t)(2 * numbers + count * NUMBERS) * sizeof *cells);
    float *normal = cells + numbers;
    int failed = !cells;
    for (intptr_t one = 0; one < several && !failed; one++) {
        float *regions = normal + numbers;
        uint16_t any = 0;
        for (intptr_t place = 0; place < numbers; place += LANES) {
            intptr_t first = place < numbers - LANES ? place : numbers - LANES;
            store(cells + first, widened(packed[one] + first) * unit);
        }
        for (intptr_t place = 0; place < numbers; place++)
            any |= packed[one][place];
        if (!(shown[one] = any != 0))
            continue;
        failed |= CALL(normalize)(cells, size, middle, beside, typical, normal);
        failed |= CALL(project)(normal, size, step, axes, origin, regions);
        float *sums = blocks ? (float *)(panels[one] + room) : NULL;
        if (sums)
            memset(sums, 0, (size_t)(blocks * blocks * NUMBERS) * sizeof *sums);
        if (background)
            CALL(subtract)(regions, background, side, block, sums);
        CALL(pack_reference)(regions, count, scale, panels[one]);
    }
    free(cells);
    return failed ? -1 : 0;
}

// Write the largest product of a query's blocks [count][width][32], over all shifts of `count` in a
// row, with those of each reference, `behind` numbers after its start.
KERNEL(lateral_products)(const float *query, intptr_t count, intptr_t width,
                         const float *const *references, intptr_t behind, intptr_t several,
                         double *found)
{
    for (intptr_t one = 0; one < several; one++) {
        found[one] = 0;
        for (intptr_t shift = 0; shift <= width - count; shift++) {
            double sums[NUMBERS] = {0}, total = 0;
            const float *own = query + shift * NUMBERS, *other = references[one] + behind;
            for (intptr_t row = 0; row < count; row++, own += (width - count) * NUMBERS)
                for (intptr_t column = 0; column < count; column++, own += NUMBERS)
                    for (int number = 0; number < NUMBERS; number++)
                        sums[number] += (double)own[number] * (double)*other++;
            for (int number = 0; number < NUMBERS; number++)
                total += sums[number];
            found[one] = total > found[one] ? total : found[one];
        }
    }
    return 0;
}
