// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// References, from their packed cells to what is compared of them, and how alike they are as wholes.

// Lay out references as they are compared, in panels; shown: 0 for one without any gradient.
//
// packed: cells [size][size][8] of each in half precision, to be multiplied by `unit`. They are
// normalised (see there) if `typical` is not 0, and less the background if there is one. A panel has
// the regions, those of every `step`-th row and column, in `room` bytes, and ends with the sums of
// blocks of all regions if these are asked for, as is a background. Without a scale regions are
// floats as they come; else they are bytes.
KERNEL(prepare)(const uint16_t *const *packed, intptr_t several, intptr_t size, int step,
                float unit, float middle, float beside, double typical, const float *axes,
                const float *origin, const float *background, intptr_t block, float scale,
                intptr_t room, int8_t *const *panels, int8_t *shown)
{
    intptr_t side = (size - SPAN) / step + 1, count = side * side, numbers = size * size * BINS;
    intptr_t blocks = block ? (side + block - 1) / block : 0;
    // Cells as they are, and normalised; regions.
    float *cells = malloc((size_t)(2 * numbers + count * NUMBERS) * sizeof *cells);
    float *normal = cells + numbers;
    int failed = !cells;
    for (intptr_t one = 0; one < several && !failed; one++) {
        float *regions = scale > 0 ? normal + numbers : (float *)panels[one];
        uint16_t any = 0;
        for (intptr_t place = 0; place < numbers; place += LANES) {
            intptr_t first = place < numbers - LANES ? place : numbers - LANES;
            store(cells + first, widened(packed[one] + first) * unit);
        }
        for (intptr_t place = 0; place < numbers; place++)
            any |= packed[one][place];
        if (!(shown[one] = any != 0))
            continue;
        if (typical > 0)
            failed |= CALL(normalize)(cells, size, middle, beside, typical, normal);
        failed |= CALL(project)(typical > 0 ? normal : cells, size, step, axes, origin, regions);
        float *sums = blocks ? (float *)(panels[one] + room) : NULL;
        if (sums)
            memset(sums, 0, (size_t)(blocks * blocks * NUMBERS) * sizeof *sums);
        if (background)
            CALL(subtract)(regions, background, side, block, sums);
        if (scale > 0)
            CALL(pack_reference)(regions, count, scale, 0, panels[one]);
    }
    free(cells);
    return failed ? -1 : 0;
}

// Write the largest product of a query's blocks [count][width][32], wherever the first `count` of a
// row begin, with those of each reference, `behind` numbers after its beginning.
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
