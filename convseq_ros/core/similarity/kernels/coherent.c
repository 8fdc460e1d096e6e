// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Coherent pair scores: counterparts of regions both ways by tiles, then votes for a shift.

enum {
    REACH = 6, // of the window of votes, as COHERENT has it
    MARGIN = 8, // of a grid: room for the window, in whole vectors; as in kernels.py
};

// The state of comparing a query with references; regions are numbered row by row.
typedef struct {
    intptr_t count, all; // salient regions of the query; regions of an image
    intptr_t side, width; // regions in a row of an image; shifts in a row of a grid of votes
    const double *window; // weights of votes from the middle on, [REACH + 1]
    const int32_t *sums; // initial values of dot products of the query's regions
    const int32_t *start, *end; // positions of regions in a grid: a vote is end - start
    const int32_t *labels; // 0, 1, 2, ...
    intptr_t vectors; // of regions of an image
    Words *columns, *back; // the best product of each column so far, and its row
    int32_t *there; // best counterparts of the query's regions
    double *votes, *smooth; // grids of shifts, with a margin for the window
} Pair;

// Allocate a pair's memory; return whether there is any.
static int begin(Pair *pair)
{
    intptr_t tiles = rounded_up(pair->count, ROWS), columns = rounded_up(pair->all, COLUMNS);
    intptr_t grid = pair->width * pair->width, bytes = (2 * columns + tiles) * 4;
    pair->columns = aligned_alloc(64, (size_t)rounded_up(bytes, 64));
    pair->votes = calloc((size_t)(2 * grid), sizeof(double));
    pair->vectors = columns / LANES;
    pair->back = pair->columns + pair->vectors;
    pair->there = (int32_t *)(pair->back + pair->vectors);
    pair->smooth = pair->votes + grid;
    return pair->columns && pair->votes;
}

// Return numbers blended with those up to REACH steps to either side.
INLINE Doubles blended(const double *from, const double *window, intptr_t step)
{
    Doubles total = doubles(from);
#pragma GCC unroll 6
    for (int away = 1; away <= REACH; away++)
        total += window[away] * (doubles(from - away * step) + doubles(from + away * step));
    return total;
}

// Write the share of votes for the best shift, and that shift, the first of equals; see
// `coherent_score`.
static void vote(Pair *pair, double found[3])
{
    intptr_t width = pair->width, side = pair->side, span = 2 * side - 1;
    intptr_t first = MARGIN * (width + 1);
    const int32_t *back = (int32_t *)pair->back;
    double share = (double)pair->count / (double)pair->all, peak = 0, peak_row = 0, peak_column = 0;
    double *middle = pair->votes + first + (side - 1) * (width + 1);
    memset(pair->votes, 0, (size_t)(width * width) * sizeof(double));
    for (intptr_t row = 0; row < pair->count; row++)
        middle[pair->end[pair->there[row]] - pair->start[row]] += 1;
    for (intptr_t place = 0; place < pair->all; place++)
        middle[pair->end[place] - pair->start[back[place]]] += share;
    for (intptr_t place = first; place < first + span * width; place += LANES / 2)
        *(DoublesAnywhere *)(pair->smooth + place) = blended(pair->votes + place, pair->window, 1);
    // First the best row of every column, then the best column.
    for (intptr_t column = 0; column < span; column += LANES / 2) {
        Doubles best = {0}, best_row = {0};
        for (intptr_t row = 0; row < span; row++) {
            const double *own = pair->smooth + first + row * width + column;
            Doubles total = blended(own, pair->window, width);
            Longs better = total > best;
            best = (Doubles)((better & (Longs)total) | (~better & (Longs)best));
            best_row = (Doubles)((better & (Longs)((double)row - (Doubles){})) |
                                 (~better & (Longs)best_row));
        }
        for (intptr_t lane = 0; lane < LANES / 2 && column + lane < span; lane++)
            if (best[lane] > peak || (best[lane] == peak && best_row[lane] < peak_row))
                peak = best[lane], peak_row = best_row[lane], peak_column = (double)(column + lane);
    }
    double score = peak / (2 * (double)pair->count);
    found[0] = score < 1 ? score : 1;
    found[1] = peak_row - (double)(side - 1);
    found[2] = peak_column - (double)(side - 1);
}

// Find the counterparts of a tile's rows, and update those of all columns. A word holds a
// dot product and, in its low bits, row plus vector, so a single maximum finds both: in this loop
// every instruction counts. Of equal products the last one is taken.
static void match(Pair *pair, const void *query, const void *reference, intptr_t first)
{
    Words best[ROWS];
    for (int row = 0; row < ROWS; row++)
        best[row] = splat(INT32_MIN);
    for (intptr_t vector = 0; vector < pair->vectors; vector += 2) {
        Words words[ROWS][2], highest[2];
        labelled_dots((const int8_t *)query + first * NUMBERS,
                      (const int8_t *)reference + vector * LANES * NUMBERS, pair->sums + first,
                      pair->labels + first + vector, words);
#pragma GCC unroll 16
        for (int row = 0; row < ROWS; row++) {
            Words left = words[row][0], right = words[row][1];
            best[row] = larger(best[row], larger(left, right));
            highest[0] = row ? larger(highest[0], left) : left;
            highest[1] = row ? larger(highest[1], right) : right;
        }
        pair->columns[vector] = larger(pair->columns[vector], highest[0]);
        pair->columns[vector + 1] = larger(pair->columns[vector + 1], highest[1]);
    }
    for (int row = 0; row < ROWS; row++) { // of equal products the last one is taken here, too
        Words vector = (best[row] & LABEL) - (int32_t)(first + row);
        Words regions = vector * LANES + *(const WordsAnywhere *)TURNED;
        pair->there[first + row] = largest((best[row] & ~LABEL) | regions) & LABEL;
    }
}

// Write score and shift, [several][3], of a query and each reference, by bytes, whose products are
// exact. The rest is as in `Pair`; start, end and labels are padded to full tiles.
KERNEL(compare)(const void *query, const int32_t *sums, const int32_t *start, intptr_t count,
                intptr_t side, intptr_t width, const int32_t *end, const int32_t *labels,
                const double *window, const void *const *references, intptr_t several,
                double (*found)[3])
{
    Pair pair = {.count = count, .all = side * side, .side = side, .width = width, .window = window,
                 .sums = sums, .start = start, .end = end, .labels = labels};
    int ready = begin(&pair);
    for (intptr_t one = 0; one < several && ready; one++) {
        for (intptr_t vector = 0; vector < pair.vectors; vector++)
            pair.columns[vector] = splat(INT32_MIN);
        for (intptr_t first = 0; first < count; first += ROWS)
            match(&pair, query, references[one], first);
        for (intptr_t vector = 0; vector < pair.vectors; vector++)
            pair.back[vector] = (pair.columns[vector] & LABEL) - (int32_t)vector;
        vote(&pair, found[one]);
    }
    free(pair.columns);
    free(pair.votes);
    return ready ? 0 : -1;
}
