// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Coherent pair scores: counterparts of regions both ways by tiles, then votes for a shift.

enum {
    REACH = 6, // of the window of votes, as CoherentConstants has it
    MARGIN = 8, // of a grid of votes: room for the window, in whole vectors
};

// What comparing one query with references needs; regions are numbered row by row.
typedef struct {
    intptr_t count, side; // salient regions of the query; regions in a row of an image
    const double *window; // weights of votes from the middle on, [REACH + 1]
    const int32_t *sums; // what dot products of the query's regions begin with
    intptr_t all, vectors; // regions of an image; vectors of them, up to full tiles
    int32_t *there, *back; // best counterparts of the query's regions and of the reference's
    int32_t *start, *end; // where regions lie in a grid of shifts: a vote is end less start
    int32_t *labels; // of the rows of a tile in every vector of a reference
    Words *columns, *places; // of each column the best so far, and where that was
    double *votes, *smooth; // grids of shifts, with room for the window around them
} Pair;

static intptr_t grid_width(const Pair *pair)
{
    return rounded_up(2 * pair->side - 1, MARGIN) + 2 * MARGIN;
}

// Allocate a pair's memory, which starts with its columns; return whether there is any. index:
// where the query's regions lie.
static int begin(Pair *pair, const int64_t *index)
{
    pair->all = pair->side * pair->side;
    intptr_t tiles = rounded_up(pair->count, ROWS), columns = rounded_up(pair->all, COLUMNS);
    intptr_t width = grid_width(pair), vectors = pair->vectors = columns / LANES;
    size_t numbers = (size_t)(4 * columns + 2 * tiles + vectors * ROWS);
    pair->columns = aligned_alloc(64, (numbers * sizeof(int32_t) + 63) / 64 * 64);
    size_t grid = (size_t)(width * width) * sizeof(double);
    pair->votes = aligned_alloc(64, 2 * grid);
    if (!pair->columns || !pair->votes)
        return 0;
    memset(pair->votes, 0, 2 * grid);
    pair->places = pair->columns + vectors;
    pair->end = (int32_t *)(pair->places + vectors);
    pair->back = pair->end + columns;
    pair->start = pair->back + columns;
    pair->there = pair->start + tiles;
    pair->labels = pair->there + tiles;
    pair->smooth = pair->votes + width * width;
    for (intptr_t place = 0; place < pair->all; place++)
        pair->end[place] = (int32_t)(place / pair->side * width + place % pair->side);
    for (intptr_t row = 0; row < pair->count; row++)
        pair->start[row] = pair->end[index[row]];
    for (intptr_t label = 0; label < vectors * ROWS; label++)
        pair->labels[label] = (int32_t)((uint32_t)(label % ROWS << ROW_BIT | label / ROWS)
                                        << LABEL_SHIFT);
    return 1;
}

static inline int32_t least(int32_t one, intptr_t other)
{
    return one < other ? one : (int32_t)other;
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
    intptr_t width = grid_width(pair), side = pair->side, span = 2 * side - 1;
    intptr_t first = MARGIN * (width + 1);
    double share = (double)pair->count / (double)pair->all, peak = 0, peak_row = 0, peak_column = 0;
    double *middle = pair->votes + first + (side - 1) * (width + 1);
    memset(pair->votes, 0, (size_t)(width * width) * sizeof(double));
    for (intptr_t row = 0; row < pair->count; row++)
        middle[pair->end[pair->there[row]] - pair->start[row]] += 1;
    for (intptr_t place = 0; place < pair->all; place++)
        middle[pair->end[place] - pair->start[pair->back[place]]] += share;
    for (intptr_t place = first; place < first + span * width; place += LANES / 2)
        *(Doubles *)(pair->smooth + place) = blended(pair->votes + place, pair->window, 1);
    // Of every column the best row, then of these the best.
    for (intptr_t column = 0; column < span; column += LANES / 2) {
        Doubles best = {0}, best_row = {0};
        for (intptr_t row = 0; row < span; row++) {
            Doubles total = blended(pair->smooth + first + row * width + column, pair->window, width);
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

// Raise the best counterparts of a tile's rows and of two vectors of columns, by bytes. Words are
// a dot product and, below it, its label: one maximum finds both, where every instruction on a sum
// costs time. Of equal products the last counts, however many rows and columns a tile has.
INLINE void keep_words(const QueryNumber *query, const int8_t *block, const int32_t *start,
                       const int32_t *labels, int32_t first, Words best[ROWS], Words columns[2],
                       Words places[2])
{
    Words sums[ROWS][2], highest[2];
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++) {
        sums[row][0] = beginning(start[row], labels[row]);
        sums[row][1] = beginning(start[row], labels[ROWS + row]);
    }
    add_byte_dots(query, block, sums);
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++) {
        Words left = labelled(sums[row][0], labels[row]);
        Words right = labelled(sums[row][1], labels[ROWS + row]);
        best[row] = larger(best[row], larger(left, right));
        highest[0] = row ? larger(highest[0], left) : left;
        highest[1] = row ? larger(highest[1], right) : right;
    }
#pragma GCC unroll 2
    for (int half = 0; half < 2; half++) {
        Words better = (highest[half] | splat(LABEL)) > columns[half];
        places[half] = chosen(better, splat(first), places[half]);
        columns[half] = chosen(better, highest[half], columns[half]);
    }
}

// Raise the best counterparts of a tile's rows and columns by floats; of equal ones the first stays.
INLINE void keep_counterparts(const float *query, const float *block, int32_t vector,
                              int32_t first, Floats best[ROWS], Words there[ROWS],
                              Floats columns[2], Words places[2])
{
    Floats dots[ROWS][2];
    float_dots(query, block, NUMBERS, dots);
#pragma GCC unroll 16
    for (int row = 0; row < ROWS; row++)
#pragma GCC unroll 2
        for (int half = 0; half < 2; half++) {
            keep_larger(dots[row][half], splat(vector + half), best + row, there + row);
            keep_larger(dots[row][half], splat(first + row), columns + half, places + half);
        }
}

// Find the counterparts of a tile's rows, and raise those of all columns, by bytes.
static void match_bytes(Pair *pair, const void *query, const void *reference, intptr_t first)
{
    Words best[ROWS];
    for (int row = 0; row < ROWS; row++)
        best[row] = splat(INT32_MIN);
    for (intptr_t vector = 0; vector < pair->vectors; vector += 2)
        keep_words((const QueryNumber *)query + first * NUMBERS,
                   (const int8_t *)reference + vector * LANES * NUMBERS, pair->sums + first,
                   pair->labels + vector * ROWS, (int32_t)first, best, pair->columns + vector,
                   pair->places + vector);
    for (int row = 0; row < ROWS; row++) { // of equal products the last region's counts here, too
        Words regions = (best[row] & VECTOR) * LANES + *(const WordsAnywhere *)TURNED;
        pair->there[first + row] = largest((best[row] & ~LABEL) | regions) & LABEL;
    }
}

// Find the counterparts of a tile's rows, and raise those of all columns, by floats.
static void match_floats(Pair *pair, const void *query, const void *reference, intptr_t first)
{
    Floats best[ROWS];
    Words there[ROWS] = {0};
    for (int row = 0; row < ROWS; row++)
        best[row] = spread(-INFINITY);
    for (intptr_t vector = 0; vector < pair->vectors; vector += 2)
        keep_counterparts((const float *)query + first * NUMBERS,
                          (const float *)reference + vector * LANES * NUMBERS, (int32_t)vector,
                          (int32_t)first, best, there, (Floats *)pair->columns + vector,
                          pair->places + vector);
    for (int row = 0; row < ROWS; row++) {
        float highest = -INFINITY;
        for (int lane = 0; lane < LANES; lane++) {
            int32_t region = there[row][lane] * LANES + lane;
            if (best[row][lane] > highest ||
                (best[row][lane] == highest && region < pair->there[first + row])) {
                highest = best[row][lane];
                pair->there[first + row] = region;
            }
        }
    }
}

// Write score and shift, [several][3], of a query and each reference.
static int compare(Pair *pair, int bytes, const void *query, const int64_t *index,
                   const void *const *references, intptr_t several, double (*found)[3])
{
    int ready = begin(pair, index);
    for (intptr_t one = 0; one < several && ready; one++) {
        for (intptr_t vector = 0; vector < pair->vectors; vector++)
            pair->columns[vector] = bytes ? splat(INT32_MIN) : (Words)spread(-INFINITY);
        for (intptr_t first = 0; first < pair->count; first += ROWS)
            (bytes ? match_bytes : match_floats)(pair, query, references[one], first);
        // What is beyond the last region is the last again.
        for (intptr_t row = 0; row < pair->count; row++)
            pair->there[row] = least(pair->there[row], pair->all - 1);
        for (intptr_t place = 0; place < pair->all; place++) {
            int32_t row = ((int32_t *)pair->places)[place], word = ((int32_t *)pair->columns)[place];
            pair->back[place] = least(row + (bytes ? (word & LABEL) >> ROW_BIT : 0), pair->count - 1);
        }
        vote(pair, found[one]);
    }
    free(pair->columns);
    free(pair->votes);
    return ready ? 0 : -1;
}

// By products of bytes, which are exact. sums: what those of the query's regions begin with;
// index: where these lie; window: from the middle on, [REACH + 1].
KERNEL(compare_bytes)(const QueryNumber *query, const int32_t *sums, const int64_t *index,
                      intptr_t count, intptr_t side, const double *window,
                      const void *const *references, intptr_t several, double (*found)[3])
{
    Pair pair = {.count = count, .side = side, .window = window, .sums = sums};
    return compare(&pair, 1, query, index, references, several, found);
}

// By products of floats.
KERNEL(compare_floats)(const float *query, const int64_t *index, intptr_t count, intptr_t side,
                       const double *window, const void *const *references, intptr_t several,
                       double (*found)[3])
{
    Pair pair = {.count = count, .side = side, .window = window};
    return compare(&pair, 0, query, index, references, several, found);
}
