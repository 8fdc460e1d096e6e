// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// The paper's pair score: of each salient region of a query the best similarity anywhere.

// Write the scores of a query and each reference: by bytes, of this scale in all, if it is told
// what the sums of the query's regions begin with, else by floats. No region has negative numbers,
// so that floats are in order as whole numbers are.
KERNEL(score)(const void *query, const int32_t *start, intptr_t count, intptr_t all, double scale,
              const void *const *references, intptr_t several, float *scores)
{
    for (intptr_t one = 0; one < several; one++) {
        double total = 0;
        for (intptr_t first = 0; first < count; first += ROWS) {
            Words best[ROWS] = {0};
            for (intptr_t place = 0; place < all * NUMBERS; place += COLUMNS * NUMBERS) {
                Words sums[ROWS][2];
                if (start)
                    byte_dots((const int8_t *)query + first * NUMBERS,
                              (const int8_t *)references[one] + place, start + first, sums);
                else
                    float_dots((const float *)query + first * NUMBERS,
                               (const float *)references[one] + place, (Floats(*)[2])sums);
#pragma GCC unroll 16
                for (int row = 0; row < ROWS; row++)
                    best[row] = larger(best[row], larger(sums[row][0], sums[row][1]));
            }
            for (int row = 0; row < ROWS && first + row < count; row++) {
                int32_t highest = largest(best[row]);
                total += start ? highest : ((Floats)splat(highest))[0];
            }
        }
        double score = total / ((double)count * scale);
        scores[one] = (float)(score < 1 ? score : 1);
    }
    return 0;
}
