// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// The paper's pair score: the mean best similarity of a query's salient regions.

// Return whether the mean of the first values, of `count`, is so many standard errors off a limit.
static int is_sure(double total, double squares, double first, double count, double limit,
                   double errors)
{
    double mean = total / first, off = mean - limit;
    double variance = (squares / first - mean * mean) / first * (1 - first / count);
    return off * off > errors * errors * variance;
}

// Write the scores of a query and each reference: by bytes, with `scale` for their products, if the
// initial values of sums are given, else by floats. No region has negative numbers, so floats have
// the same order as their bits. After each `every` regions it ends if the side of the limit is
// decided; 0 disables this.
KERNEL(score)(const void *query, const int32_t *start, intptr_t count, intptr_t all, double scale,
              double limit, double errors, intptr_t every, const void *const *references,
              intptr_t several, float *scores)
{
    for (intptr_t one = 0; one < several; one++) {
        double total = 0, squares = 0;
        intptr_t summed = 0;
        while (summed < count) {
            intptr_t first = summed;
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
            for (int row = 0; row < ROWS && summed < count; row++, summed++) {
                int32_t highest = largest(best[row]);
                double similarity = start ? highest : ((Floats)splat(highest))[0];
                total += similarity;
                squares += similarity * similarity;
            }
            if (every && summed % every == 0 && summed < count &&
                is_sure(total, squares, (double)summed, (double)count, limit * scale, errors))
                break;
        }
        double score = total / ((double)summed * scale);
        scores[one] = (float)(score < 1 ? score : 1);
    }
    return 0;
}
