// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Mean scores along the diagonals of a sequence of frames, at several velocities.

enum { ENDS = 512 }; // of diagonals at a time: what rows hold of them stays in the nearest cache

// Add up the pairs on diagonals, by their ends, and count those that are known; others, outside a
// row or not numbers, count as expected. No newest pair, no score.
static void add_up(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                   const float *expected, intptr_t frames, intptr_t first, intptr_t ends,
                   float *restrict sums, int32_t *restrict known)
{
    for (intptr_t place = 0; place < ends; place++)
        sums[place] = 0, known[place] = 0;
    for (intptr_t frame = 0; frame < frames; frame++) {
        intptr_t least = steps[frame] > first ? steps[frame] - first : 0;
        intptr_t most = lengths[frame] + steps[frame] - first;
        const float *restrict row = rows[frame] + (first - steps[frame]);
        const float usual = expected[frame];
        least = least < ends ? least : ends;
        most = most < least ? least : most < ends ? most : ends;
        for (intptr_t place = 0; place < least; place++)
            sums[place] += usual;
        for (intptr_t place = most; place < ends; place++)
            sums[place] += usual;
        for (intptr_t place = least; place < most; place++) {
            float score = row[place];
            sums[place] += score == score ? score : usual;
            known[place] += score == score;
        }
        for (intptr_t place = 0; place < ends && !frame; place++)
            known[place] -= known[place] ? 0 : (int32_t)frames;
    }
}

// Write the highest and the mean score at each velocity, and how many diagonals have one: those
// that end from `reaches` on, with so many known pairs at least. steps: [velocities][frames];
// expected: zeros.
KERNEL(peaks)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
              const float *expected, const intptr_t *reaches, intptr_t velocities,
              intptr_t frames, intptr_t fewest, float *highest, double *means, int64_t *counts)
{
    float sums[ENDS + LANES];
    int32_t known[ENDS + LANES];
    for (intptr_t velocity = 0; velocity < velocities; velocity++)
        highest[velocity] = -INFINITY, means[velocity] = 0, counts[velocity] = 0;
    for (intptr_t block = 0; block < lengths[0]; block += ENDS)
        for (intptr_t velocity = 0; velocity < velocities; velocity++) {
            intptr_t first = block > reaches[velocity] ? block : reaches[velocity];
            intptr_t last = block + ENDS < lengths[0] ? block + ENDS : lengths[0];
            if (first >= last)
                continue;
            add_up(rows, lengths, steps + velocity * frames, expected, frames, first,
                   last - first, sums, known);
            for (intptr_t behind = last - first; behind < last - first + LANES; behind++)
                sums[behind] = 0, known[behind] = 0;
            // 16 sums, whatever the vectors' width, so that all processors add alike.
            Floats top = spread(-INFINITY), totals[16 / LANES] = {0};
            Words count = {0};
            for (intptr_t place = 0; place < last - first; place += LANES) {
                Words pairs = *(const WordsAnywhere *)(known + place);
                Words is_scored = pairs >= splat((int32_t)fewest);
                Floats score = floats(sums + place) / __builtin_convertvector(pairs, Floats);
                top = (Floats)chosen(is_scored & (score > top), (Words)score, (Words)top);
                totals[place / LANES % (16 / LANES)] += (Floats)((Words)score & is_scored);
                count -= is_scored;
            }
            for (int lane = 0; lane < LANES; lane++) {
                highest[velocity] = top[lane] > highest[velocity] ? top[lane] : highest[velocity];
                counts[velocity] += count[lane];
            }
            for (int sum = 0; sum < 16; sum++)
                means[velocity] += (double)totals[sum / LANES][sum % LANES];
        }
    for (intptr_t velocity = 0; velocity < velocities; velocity++)
        if (counts[velocity])
            means[velocity] /= (double)counts[velocity];
        else
            highest[velocity] = 0;
    return 0;
}

// Write the mean scores along all diagonals, by their ends, or -inf with fewer known pairs.
KERNEL(partial_scores)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                       const float *expected, intptr_t frames, intptr_t fewest, float *scores)
{
    int32_t known[ENDS];
    for (intptr_t first = 0; first < lengths[0]; first += ENDS) {
        intptr_t ends = lengths[0] - first < ENDS ? lengths[0] - first : ENDS;
        add_up(rows, lengths, steps, expected, frames, first, ends, scores + first, known);
        for (intptr_t place = 0; place < ends; place++)
            scores[first + place] =
                known[place] >= fewest ? scores[first + place] / (float)frames : -INFINITY;
    }
    return 0;
}
