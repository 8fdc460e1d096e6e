// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Mean scores along the diagonals of a sequence of frames.

enum {
    ENDS = 512, // of diagonals at a time: what rows hold of them stays in the nearest cache
    STRIDE = 64, // of them at once, whose sums stay in registers
};

// Add up the pairs on diagonals, by their ends, if all are known and in their session, with room
// for a stride behind; return whether they are, else the sums are worth nothing.
static int add_up_known(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                        intptr_t start, intptr_t end, intptr_t frames, intptr_t first,
                        intptr_t ends, float *restrict sums)
{
    Words unknown = {0};
    for (intptr_t frame = 0; frame < frames; frame++) {
        intptr_t met = first - steps[frame], length = lengths[frame] < end ? lengths[frame] : end;
        if (met < start || met + ends + STRIDE > length)
            return 0;
    }
    for (intptr_t place = 0; place < ends; place += STRIDE) {
        Floats total[STRIDE / LANES] = {0};
        for (intptr_t frame = 0; frame < frames; frame++)
#pragma GCC unroll 8
            for (int one = 0; one < STRIDE / LANES; one++)
                total[one] += floats(rows[frame] + first - steps[frame] + place + one * LANES);
        for (int one = 0; one < STRIDE / LANES; one++)
            unknown |= total[one] != total[one];
        memcpy(sums + place, total, sizeof total);
    }
    for (int lane = 0; lane < LANES; lane++)
        if (unknown[lane])
            return 0;
    return 1;
}

// Add up the pairs on diagonals, by their ends, and count those that are known; others, outside a
// row or the session, or not numbers, count as expected. No newest pair, no score.
static void add_up(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                   const float *expected, intptr_t start, intptr_t end, intptr_t frames,
                   intptr_t first, intptr_t ends, float *restrict sums, int32_t *restrict known)
{
    int is_done = add_up_known(rows, lengths, steps, start, end, frames, first, ends, sums);
    for (intptr_t place = 0; place < ends; place++) {
        known[place] = is_done ? (int32_t)frames : 0;
        sums[place] = is_done ? sums[place] : 0;
    }
    for (intptr_t frame = 0; frame < frames && !is_done; frame++) {
        intptr_t length = lengths[frame] < end ? lengths[frame] : end;
        const int32_t otherwise = frame ? 0 : -(int32_t)frames;
        for (intptr_t place = 0; place < ends; place++) {
            intptr_t met = first + place - steps[frame];
            float score = met >= start && met < length ? rows[frame][met] : NAN;
            sums[place] += score == score ? score : expected[frame];
            known[place] += score == score ? 1 : otherwise;
        }
    }
}

// Write the mean scores along all diagonals, by their ends, or -inf with fewer known pairs. What
// lies partly off its session counts, too, unless they are to be whole: then a diagonal, which
// reaches from so far before its end or, negative, to after it, is scored inside its session
// alone, and its mean is that of the known pairs.
KERNEL(scores_along)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                     const float *expected, const int64_t *bounds, intptr_t frames,
                     intptr_t fewest, intptr_t reach, intptr_t is_whole, float *scores)
{
    int32_t known[ENDS];
    for (intptr_t session = 0, first = 0; first < lengths[0];) {
        intptr_t start = bounds[session], end = bounds[session + 1];
        intptr_t ends = end - first < ENDS ? end - first : ENDS;
        add_up(rows, lengths, steps, expected, start, end, frames, first, ends, scores + first,
               known);
        for (intptr_t place = 0; place < ends; place++) {
            intptr_t at = first + place;
            int is_inside = reach < 0 ? at < end + reach : at >= start + reach;
            int is_scored = known[place] >= fewest && (is_inside || !is_whole);
            float count = (float)(is_whole ? known[place] : frames);
            scores[at] = is_scored ? scores[at] / count : -INFINITY;
        }
        first += ends;
        session += first == end;
    }
    return 0;
}
