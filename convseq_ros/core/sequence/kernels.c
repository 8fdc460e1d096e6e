// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Mean scores along the diagonals of a sequence of frames, at several velocities.

enum { ENDS = 512 }; // of diagonals at a time: what rows hold of them stays in the nearest cache

// Add up what is known of the pairs on diagonals, by their ends, and count it; no newest pair, no
// score. What lies behind a row is not known, as what is not a number.
static void add_up(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                   intptr_t frames, intptr_t first, intptr_t ends, float *sums, int32_t *known)
{
    for (intptr_t place = 0; place < ends; place++)
        sums[place] = 0, known[place] = 0;
    for (intptr_t frame = 0; frame < frames; frame++) {
        intptr_t least = steps[frame] > first ? steps[frame] - first : 0;
        intptr_t most = lengths[frame] + steps[frame] - first;
        intptr_t met = first - steps[frame];
        for (intptr_t place = least; place < (most < ends ? most : ends); place++) {
            float score = rows[frame][met + place];
            int32_t there = score == score;
            sums[place] += there ? score : 0;
            known[place] += there;
        }
        for (intptr_t place = 0; place < ends && !frame; place++)
            known[place] -= known[place] ? 0 : (int32_t)frames;
    }
}

// Write the highest and the mean score at each velocity, and how many diagonals have one: those
// that end from `reaches` on, with so many known pairs at least. steps: [velocities][frames].
KERNEL(peaks)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
              const intptr_t *reaches, intptr_t velocities, intptr_t frames, intptr_t fewest,
              float *highest, double *means, int64_t *counts)
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
            add_up(rows, lengths, steps + velocity * frames, frames, first, last - first, sums,
                   known);
            for (intptr_t behind = last - first; behind < last - first + LANES; behind++)
                sums[behind] = 0, known[behind] = 0;
            Floats top = spread(-INFINITY), total = {0};
            Words count = {0};
            for (intptr_t place = 0; place < last - first; place += LANES) {
                Words pairs = *(const WordsAnywhere *)(known + place);
                Words is_scored = pairs >= splat((int32_t)fewest);
                Floats score = floats(sums + place) / __builtin_convertvector(pairs, Floats);
                top = (Floats)chosen(is_scored & (score > top), (Words)score, (Words)top);
                total += (Floats)((Words)score & is_scored);
                count -= is_scored;
            }
            for (int lane = 0; lane < LANES; lane++) {
                highest[velocity] = top[lane] > highest[velocity] ? top[lane] : highest[velocity];
                means[velocity] += (double)total[lane];
                counts[velocity] += count[lane];
            }
        }
    for (intptr_t velocity = 0; velocity < velocities; velocity++)
        if (counts[velocity])
            means[velocity] /= (double)counts[velocity];
        else
            highest[velocity] = 0;
    return 0;
}
