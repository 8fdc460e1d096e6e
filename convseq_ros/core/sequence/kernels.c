// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Mean scores along the diagonals of a sequence of frames, at several velocities.

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
    for (intptr_t place = 0; place < ends; place++)
        known[place] = is_done ? (int32_t)frames : 0;
    if (is_done)
        return;
    memset(sums, 0, (size_t)ends * sizeof *sums);
    for (intptr_t frame = 0; frame < frames; frame++) {
        intptr_t least = start + steps[frame] > first ? start + steps[frame] - first : 0;
        intptr_t length = lengths[frame] < end ? lengths[frame] : end;
        intptr_t most = length + steps[frame] - first;
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

// Return where a session ends: where the next one, or the newest row, does.
static intptr_t end_of(intptr_t session, const int64_t *starts, intptr_t sessions, intptr_t length)
{
    int next = session + 1 < sessions && starts[session + 1] < length;
    return next ? (intptr_t)starts[session + 1] : length;
}

// Write the highest and the mean score at each velocity, and how many diagonals have one: those
// that lie in their session, from `reaches` before their end or, negative, to after it, with so
// many known pairs at least. steps: [velocities][frames]; expected: zeros.
KERNEL(peaks)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
              const float *expected, const int64_t *starts, intptr_t sessions,
              const intptr_t *reaches, intptr_t velocities, intptr_t frames, intptr_t fewest,
              float *highest, double *means, int64_t *counts)
{
    float sums[ENDS + STRIDE];
    int32_t known[ENDS + LANES];
    for (intptr_t velocity = 0; velocity < velocities; velocity++)
        highest[velocity] = -INFINITY, means[velocity] = 0, counts[velocity] = 0;
    for (intptr_t session = 0, block = 0, start = 0; block < lengths[0];) {
        intptr_t end = end_of(session, starts, sessions, lengths[0]);
        intptr_t last = block + ENDS < end ? block + ENDS : end;
        for (intptr_t velocity = 0; velocity < velocities; velocity++) {
            intptr_t reach = reaches[velocity], least = reach > 0 ? start + reach : start;
            intptr_t most = reach < 0 ? end + reach : end, first = block > least ? block : least;
            intptr_t ends = (last < most ? last : most) - first;
            if (ends <= 0)
                continue;
            add_up(rows, lengths, steps + velocity * frames, expected, start, end, frames, first,
                   ends, sums, known);
            for (intptr_t behind = ends; behind < ends + LANES; behind++)
                sums[behind] = 0, known[behind] = 0;
            // 16 sums, whatever the vectors' width, so that all processors add alike.
            Floats top = spread(-INFINITY), totals[16 / LANES] = {0};
            Words count = {0};
            for (intptr_t place = 0; place < ends; place += LANES) {
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
        if (last == end)
            session++, start = end;
        block = last;
    }
    for (intptr_t velocity = 0; velocity < velocities; velocity++)
        if (counts[velocity])
            means[velocity] /= (double)counts[velocity];
        else
            highest[velocity] = 0;
    return 0;
}

// Write the mean scores along all diagonals, by their ends, or -inf with fewer known pairs. What
// lies partly off its session counts, too, unless they are to be whole: then a diagonal, which
// reaches from so far before its end or, negative, to after it, is scored inside its session
// alone, and its mean is that of the known pairs.
KERNEL(scores_along)(const float *const *rows, const intptr_t *lengths, const intptr_t *steps,
                     const float *expected, const int64_t *starts, intptr_t sessions,
                     intptr_t frames, intptr_t fewest, intptr_t reach, intptr_t is_whole,
                     float *scores)
{
    int32_t known[ENDS];
    for (intptr_t session = 0, first = 0, start = 0; first < lengths[0];) {
        intptr_t end = end_of(session, starts, sessions, lengths[0]);
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
        if (first == end)
            session++, start = end;
    }
    return 0;
}
