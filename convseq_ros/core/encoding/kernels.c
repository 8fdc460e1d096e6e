// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// From an image to its cells, entropy and projected regions.

#define DEGREES 57.29577951308232f // of a radian

enum {
    CELL_PX = 16,
    BINS = 8,
    SPAN = 3, // cells in a row of a projected region
    REGION_ROWS = ROWS < 8 ? ROWS : 10, // regions that are projected at once; a row has 30
};

// Number of cells in a row that these regions cover, at a given step.
#define TILE_CELLS(step) ((REGION_ROWS - 1) * (step) + SPAN)

// Change a level's count; return the change of its term.
static inline double changed(int *count, int by, const double *terms)
{
    double before = terms[*count];
    return terms[*count += by] - before;
}

// Fill in the sum of a function of each level's count in a disk around every pixel.
//
// The disk slides along a row: counts and sum are updated for pixels that enter and leave it.
// levels: [height + diameter - 1][width + diameter - 1], below 257; terms: the function, at every
// count from 0, such that sums of its values are exact; sums: [height][width].
KERNEL(disk_sums)(const uint16_t *levels, const int64_t *half_widths, intptr_t diameter,
                       const double *terms, intptr_t height, intptr_t width, double *sums)
{
    intptr_t radius = diameter / 2, line = width + diameter - 1;
    for (intptr_t y = 0; y < height; y++) {
        int counts[257] = {0};
        double total = 0;
        const uint16_t *first = levels + y * line;
        for (intptr_t row = 0; row < diameter; row++)
            for (intptr_t x = radius - half_widths[row]; x <= radius + half_widths[row]; x++)
                total += changed(&counts[first[row * line + x]], 1, terms);
        sums[y * width] = total;
        for (intptr_t x = 1; x < width; x++) {
            for (intptr_t row = 0; row < diameter; row++) {
                const uint16_t *middle = first + row * line + x + radius;
                total += changed(&counts[middle[-1 - half_widths[row]]], -1, terms);
                total += changed(&counts[middle[half_widths[row]]], 1, terms);
            }
            sums[y * width + x] = total;
        }
    }
    return 0;
}

// Both factors of a 5 x 5 Sobel filter, along a line of an image with a margin of two pixels.
static void across(const double *restrict line, intptr_t side, double *restrict slopes,
                   double *restrict means)
{
    for (intptr_t x = 0; x < side; x++) {
        double a = line[x], b = line[x + 1], c = line[x + 2], d = line[x + 3], e = line[x + 4];
        // This order of operations gives the same rounding for equal pixels as OpenCV.
        slopes[x] = -a - 2 * b + 2 * d + e;
        means[x] = a + 4 * b + 6 * c + 4 * d + e;
    }
}

// Strength and orientation, in bins, of gradients from five lines of slopes and of means.
static void gradients(double *const slopes[5], double *const means[5], intptr_t side,
                      float *restrict strength, float *restrict orientation)
{
    double *const *s = slopes, *const *m = means;
    for (intptr_t x = 0; x < side; x++) {
        strength[x] = (float)(6 * s[2][x] + 4 * (s[3][x] + s[1][x]) + (s[4][x] + s[0][x]));
        orientation[x] = (float)(2 * (m[3][x] - m[1][x]) + (m[4][x] - m[0][x]));
    }
    for (intptr_t x = 0; x < side; x++) {
        float gx = strength[x], gy = orientation[x];
        float wide = fabsf(gx), high = fabsf(gy);
        // The arc tangent in degrees, by the polynomial of degree 7 of cv2.phase.
        float ratio = (wide < high ? wide : high) / ((wide < high ? high : wide) + 0x1p-52f);
        float square = ratio * ratio;
        float angle = (((DEGREES * -0.04432655554792128f * square + DEGREES * 0.1555786518463281f) *
                            square + DEGREES * -0.3258083974640975f) *
                           square + DEGREES * 0.9997878412794807f) * ratio;
        angle = wide < high ? 90 - angle : angle;
        angle = gx < 0 ? 180 - angle : angle;
        angle = gy < 0 ? 360 - angle : angle;
        strength[x] = fabsf(gx + gy) * 0.5f;
        orientation[x] = angle * (BINS / 360.0f);
    }
}

// Add the votes of a line's pixels for each bin; angles just below 360 degrees vote for the ninth.
static void vote_for_bins(const float *restrict strength, const float *restrict orientation,
                          intptr_t side, float *restrict votes)
{
    for (int bin = 0; bin <= BINS; bin++)
        for (intptr_t x = 0; x < side; x++) {
            float share = 1 - fabsf(orientation[x] - (float)bin);
            votes[bin * side + x] += strength[x] * (share > 0 ? share : 0);
        }
}

// Fill in the histograms [side / 16][side / 16][8] of a square image [side + 4][side + 4], which
// has a margin of two pixels; gamma: of each level. Return 0, or -1 if there is no memory.
KERNEL(histograms)(const uint8_t *framed, intptr_t side, const double *gamma, float *cells)
{
    intptr_t width = side + 4;
    double *lines = malloc((size_t)(10 * side + width + (BINS + 3) * side) * sizeof *lines);
    double *corrected = lines + 10 * side, *slopes[5], *means[5];
    float *strength = (float *)(corrected + width), *orientation = strength + side;
    float *votes = orientation + side;
    for (intptr_t y = 0; y < width && lines; y++) {
        for (intptr_t x = 0; x < width; x++)
            corrected[x] = gamma[framed[y * width + x]];
        for (int past = 0; past < 5; past++) {
            slopes[past] = lines + (y + 1 + past) % 5 * side;
            means[past] = slopes[past] + 5 * side;
        }
        across(corrected, side, slopes[4], means[4]);
        intptr_t row = y - 4;
        if (row < 0)
            continue;
        gradients(slopes, means, side, strength, orientation);
        if (row % CELL_PX == 0)
            memset(votes, 0, (size_t)((BINS + 1) * side) * sizeof *votes);
        vote_for_bins(strength, orientation, side, votes);
        if (row % CELL_PX < CELL_PX - 1)
            continue;
        for (intptr_t x = 0; x < side; x++)
            votes[x] += votes[BINS * side + x];
        for (intptr_t cell = 0; cell < side / CELL_PX; cell++)
            for (int bin = 0; bin < BINS; bin++) {
                float *own = votes + bin * side + cell * CELL_PX;
                for (int half = CELL_PX / 2; half; half /= 2)
                    for (int x = 0; x < half; x++)
                        own[x] += own[x + half];
                cells[(row / CELL_PX * (side / CELL_PX) + cell) * BINS + bin] = own[0];
            }
    }
    free(lines);
    return lines ? 0 : -1;
}

// Write numbers times a factor less an origin, at unit length. The order of sums is fixed.
static inline void place_region(const float *numbers, float factor, const float *origin,
                                float *region)
{
    Floats moved[NUMBERS / LANES], squares[NUMBERS / LANES];
#pragma GCC unroll 8
    for (int part = 0; part < NUMBERS / LANES; part++) {
        moved[part] = floats(numbers + part * LANES) * factor - floats(origin + part * LANES);
        squares[part] = moved[part] * moved[part];
    }
    float total = added_up(squares, NUMBERS / LANES);
    float inverse = total > 0 ? 1 / sqrtf(total) : 1;
#pragma GCC unroll 8
    for (int part = 0; part < NUMBERS / LANES; part++)
        store(region + part * LANES, moved[part] * inverse);
}

// Write the products of 3 x 3-cell regions, `step` cells apart, with two vectors of axes. Every
// number of a cell is loaded once for all regions of a row that it belongs to.
INLINE void project_tile(const float *cells, intptr_t line, const float *axes, int step,
                         float *dots)
{
    Floats sums[REGION_ROWS][2] = {0};
    for (int down = 0; down < SPAN; down++, cells += line)
        for (int bin = 0; bin < BINS; bin++) {
            const float *own = axes + (down * SPAN * BINS + bin) * NUMBERS;
#pragma GCC unroll 32
            for (int cell = 0; cell < TILE_CELLS(step); cell++) {
                Floats number = spread(cells[cell * BINS + bin]);
#pragma GCC unroll 16
                for (int right = 0; right < SPAN; right++) {
                    int region = (cell - right) / step;
                    if (cell < right || (cell - right) % step || region >= REGION_ROWS)
                        continue;
                    const float *pair = own + right * BINS * NUMBERS;
                    sums[region][0] = fused(floats(pair), number, sums[region][0]);
                    sums[region][1] = fused(floats(pair + LANES), number, sums[region][1]);
                }
            }
        }
    for (int row = 0; row < REGION_ROWS; row++) {
        store(dots + row * NUMBERS, sums[row][0]);
        store(dots + row * NUMBERS + LANES, sums[row][1]);
    }
}

// Fill in the projected regions of cells [size][size][8], of unit length: of the (size - 2) ** 2,
// those of every `step`-th row and column, 1 or 2. axes: [72][32]; origin: [32], the projected mean.
// Return 0, or -1 if there is no memory.
KERNEL(project)(const float *cells, intptr_t size, int step, const float *axes,
                const float *origin, float *regions)
{
    intptr_t side = (size - SPAN) / step + 1;
    // Padded for full tiles, and for the values that the last one reads beyond the image.
    intptr_t wide = size < TILE_CELLS(step) ? TILE_CELLS(step) : size;
    float *room = calloc((size_t)(size * wide * (BINS + 1)), sizeof *room);
    float *squares = room + size * wide * BINS;
    float dots[REGION_ROWS][NUMBERS];
    for (intptr_t row = 0; row < size && room; row++)
        for (intptr_t column = 0; column < size; column++)
            for (int bin = 0; bin < BINS; bin++) {
                float number = cells[(row * size + column) * BINS + bin];
                room[(row * wide + column) * BINS + bin] = number;
                squares[row * wide + column] += number * number;
            }
    for (intptr_t row = 0; row < side && room; row++)
        for (intptr_t done = 0, first; done < side; done = first + REGION_ROWS) {
            // The last tile ends with the row, and repeats some results of the one before.
            first = done > side - REGION_ROWS ? side - REGION_ROWS : done;
            first = first < 0 ? 0 : first;
            const float *tile = room + step * (row * wide + first) * BINS;
            for (int axis = 0; axis < NUMBERS; axis += COLUMNS) {
                if (step == 1)
                    project_tile(tile, wide * BINS, axes + axis, 1, dots[0] + axis);
                else
                    project_tile(tile, wide * BINS, axes + axis, 2, dots[0] + axis);
            }
            for (intptr_t column = done; column < side && column < first + REGION_ROWS; column++) {
                float total = 0;
                for (int down = 0; down < SPAN; down++)
                    for (int right = 0; right < SPAN; right++)
                        total += squares[(step * row + down) * wide + step * column + right];
                place_region(dots[column - first], total > 0 ? 1 / sqrtf(total) : 1, origin,
                             regions + (row * side + column) * NUMBERS);
            }
        }
    free(room);
    return room ? 0 : -1;
}
