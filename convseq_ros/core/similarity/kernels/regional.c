// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// The paper's pair score: of each salient region of a query the best similarity anywhere.

// Write the scores of a query and each reference by bytes, which have these scales in all.
KERNEL(score_bytes)(const QueryNumber *query, const int32_t *start, intptr_t count,
                         intptr_t all, double scale, const int8_t *const *references,
                         intptr_t several, float *scores)
{
    for (intptr_t one = 0; one < several; one++) {
        int64_t total = 0;
        for (intptr_t first = 0; first < count; first += ROWS) {
            Words best[ROWS];
            for (int row = 0; row < ROWS; row++)
                best[row] = splat(0);
            for (intptr_t place = 0; place < all; place += COLUMNS) {
                Words sums[ROWS][2];
#pragma GCC unroll 16
                for (int row = 0; row < ROWS; row++)
                    sums[row][0] = sums[row][1] = beginning(start[first + row], 0);
                add_byte_dots(query + first * NUMBERS, references[one] + place * NUMBERS, sums);
#pragma GCC unroll 16
                for (int row = 0; row < ROWS; row++)
                    best[row] = larger(best[row], larger(sums[row][0], sums[row][1]));
            }
            for (int row = 0; row < ROWS && first + row < count; row++)
                total += largest(best[row]) >> SUM_SHIFT;
        }
        double score = (double)total / ((double)count * scale);
        scores[one] = (float)(score < 1 ? score : 1);
    }
    return 0;
}

// Write the dot products of cells, rows `stride` apart.
static void keep_cell_dots(const float *query, const float *block, float *dots, intptr_t stride)
{
    Floats sums[ROWS][2];
    float_dots(query, block, BINS, sums);
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++) {
        store(dots + row * stride, sums[row][0]);
        store(dots + row * stride + LANES, sums[row][1]);
    }
}

// Return the best similarity of a region from the dot products of its two lower cells (those of
// `right` lie one further), the sums of its two upper ones and the inverse lengths of regions.
// kept: the sums of the two lower ones.
static float best_similarity(const float *left, const float *right, const float *above,
                             const float *inverse, float *restrict kept, intptr_t width)
{
    Floats best = spread(0);
    for (intptr_t place = 0; place < width; place += LANES) {
        Floats lower = floats(left + place) + floats(right + place);
        store(kept + place, lower);
        Floats similarity = (floats(above + place) + lower) * floats(inverse + place);
        best = (Floats)chosen(similarity > best, (Words)similarity, (Words)best);
    }
    float highest = 0;
    for (int lane = 0; lane < LANES; lane++)
        highest = best[lane] > highest ? best[lane] : highest;
    return highest;
}

// Write the scores of a query and each reference by floats, both as cells [side * side][8].
//
// The dot product of two regions is the sum of those of their four cells, over both lengths: a
// quarter of the products. They come in order of the query's cells; sums of two neighbours are
// kept until the row below has come too. inverse: of the lengths of the query's regions, in the
// place of their first cell, 0 where not salient; those of a reference lie behind its cells, a row
// later. Return 0, or -1 if there is no memory.
KERNEL(score_cells)(const float *query, const float *inverse, intptr_t count, intptr_t side,
                        const float *const *references, intptr_t several, float *scores)
{
    intptr_t cells = side * side, width = rounded_up(cells, COLUMNS), stride = width + COLUMNS;
    intptr_t reach = side + stride;
    float *dots = calloc((size_t)((ROWS + 1) * stride + (side + 1) * reach), sizeof *dots);
    float *sums = dots + (ROWS + 1) * stride;
    for (intptr_t one = 0; one < several && dots; one++) {
        double total = 0;
        for (intptr_t first = 0; first < cells; first += ROWS) {
            memcpy(dots, dots + ROWS * stride, (size_t)stride * sizeof *dots);
            for (intptr_t place = 0; place < width; place += COLUMNS)
                keep_cell_dots(query + first * BINS, references[one] + place * BINS,
                               dots + stride + place, stride);
            for (int row = 0; row < ROWS; row++) {
                intptr_t cell = first + row - 1, region = cell - side;
                if (cell < 0 || cell >= cells)
                    continue;
                float factor = region >= 0 ? inverse[region] : 0;
                if (factor <= 0 && inverse[cell] <= 0)
                    continue;
                const float *left = dots + row * stride;
                total += factor * best_similarity(left, left + stride + 1,
                                                  sums + (cell + 1) % (side + 1) * reach,
                                                  references[one] + width * BINS,
                                                  sums + cell % (side + 1) * reach + side, width);
            }
        }
        double score = total / (double)count;
        scores[one] = (float)(score < 1 ? score : 1);
    }
    free(dots);
    return dots ? 0 : -1;
}
