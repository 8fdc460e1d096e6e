// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// References, from their packed cells to what is compared of them, and how alike they are as wholes.

#define WHOLE 0x1p24 // length of a vector of blocks, of whole numbers, as GLOBAL_SIMILARITY has it

// Bring blocks to one length, and to whole numbers, whose products are exact in any order.
static void round_blocks(float *blocks, intptr_t count)
{
    double squares[16] = {0}, total = 0; // 16 sums, so that all processors add alike
    for (intptr_t place = 0; place < count; place += 16)
        for (int sum = 0; sum < 16; sum++)
            squares[sum] += (double)blocks[place + sum] * (double)blocks[place + sum];
    for (int sum = 0; sum < 16; sum++)
        total += squares[sum];
    double length = total > 0 ? sqrt(total) : 1;
    for (intptr_t place = 0; place < count; place++)
        blocks[place] = (float)rint(WHOLE * ((double)blocks[place] / length));
}

// Lay out references as they are compared, in panels; shown: 0 for one without any gradient.
//
// packed: cells [size][size][8] of each in half precision, to be multiplied by `unit`. They are
// normalised (see there) if `typical` is not 0, and less the background if there is one: then a
// panel ends with the blocks of its regions. Regions are bytes if there is a scale, else floats.
KERNEL(prepare)(const uint16_t *const *packed, intptr_t several, intptr_t size, float unit,
                float middle, float beside, double typical, const float *axes,
                const float *origin, const float *background, intptr_t block, float scale,
                void *const *panels, int8_t *shown)
{
    intptr_t side = size - SPAN + 1, count = side * side, numbers = size * size * BINS;
    intptr_t blocks = (side + block - 1) / block, bytes = scale > 0 ? 1 : sizeof(float);
    float *cells = malloc((size_t)(2 * numbers + count * NUMBERS) * sizeof *cells);
    float *normal = cells + numbers, *regions = normal + numbers;
    int failed = !cells;
    for (intptr_t one = 0; one < several && !failed; one++) {
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
        failed |= CALL(project)(typical > 0 ? normal : cells, size, axes, origin, regions);
        if (background) {
            float *sums = (float *)((char *)panels[one] +
                                    rounded_up(count, COLUMNS) * NUMBERS * bytes);
            memset(sums, 0, (size_t)(blocks * blocks * NUMBERS) * sizeof *sums);
            CALL(subtract)(regions, background, side, block, sums);
            round_blocks(sums, blocks * blocks * NUMBERS);
        }
        if (scale > 0)
            CALL(pack_reference)(regions, count, scale, 0, panels[one]);
        else
            CALL(pack_floats)(regions, count, 1, panels[one]);
    }
    free(cells);
    return failed ? -1 : 0;
}

// Write the largest product of a query's blocks [count][count][32], moved by up to `most` to either
// side, with those of each reference, `behind` numbers after its beginning.
KERNEL(lateral_products)(const float *query, intptr_t count, intptr_t most,
                         const float *const *references, intptr_t behind, intptr_t several,
                         double *found)
{
    for (intptr_t one = 0; one < several; one++) {
        found[one] = 0;
        for (intptr_t shift = -most; shift <= most; shift++) {
            double sums[NUMBERS] = {0}, total = 0;
            for (intptr_t row = 0; row < count; row++)
                for (intptr_t column = shift < 0 ? -shift : 0;
                     column < count - (shift > 0 ? shift : 0); column++) {
                    const float *own = query + (row * count + column + shift) * NUMBERS;
                    const float *other =
                        references[one] + behind + (row * count + column) * NUMBERS;
                    for (int number = 0; number < NUMBERS; number++)
                        sums[number] += (double)own[number] * (double)other[number];
                }
            for (int number = 0; number < NUMBERS; number++)
                total += sums[number];
            found[one] = total > found[one] ? total : found[one];
        }
    }
    return 0;
}
