// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Displacements of regions between two images, and their common motion.

enum {
    SPREAD = 32, // columns of a row are rounded up to so many
    GAP = 16, // numbers between rows that are smoothed; at least FIELD_RADIUS
    FIELD_REACH = 4, // cells about the common shift, FIELD_RADIUS: of neighbours; as FIELD has them
    FIELD_RADIUS = 3,
    FIELD_SPAN = 2 * FIELD_REACH + 1,
    FACTS = 5, // of a displacement: row, column, rows and columns moved, similarity
};

typedef struct {
    intptr_t top, bottom, left, right; // the last two of each before which it ends
} Part;

static inline int is_within(intptr_t place, intptr_t side)
{
    return (uintptr_t)place < (uintptr_t)side;
}

// The part of the query that lies inside the reference after a displacement.
static inline Part overlap(intptr_t side, intptr_t down, intptr_t right)
{
    Part part = {down < 0 ? -down : 0, down > 0 ? side - down : side,
                 right < 0 ? -right : 0, right > 0 ? side - right : side};
    return part;
}

// Lay out regions [side * side][32] as bytes, four in a word, [side][8][wide]; NaN becomes 0.
KERNEL(arrange)(const float *regions, intptr_t side, float scale, int32_t *rows)
{
    intptr_t wide = rounded_up(side, SPREAD);
    for (intptr_t place = 0; place < side * side; place++) {
        int32_t *to = rows + place / side * STEPS * wide + place % side, four;
        const float *own = regions + place * NUMBERS;
        int8_t bytes[NUMBERS];
        for (int number = 0; number < NUMBERS; number++) {
            float whole = fabsf(own[number]) < INFINITY ? rintf(own[number] * scale) : 0;
            bytes[number] = (int8_t)(whole > 127 ? 127 : whole < -127 ? -127 : whole);
        }
        for (int step = 0; step < STEPS; step++) {
            memcpy(&four, bytes + 4 * step, sizeof four);
            to[step * wide] = four;
        }
    }
    return 0;
}

// Write the initial values of sums of products for a reference, [side][wide], which compensate the
// offset of the query's bytes.
static inline void write_starts(const int32_t *reference, intptr_t side, intptr_t wide,
                                int32_t *starts)
{
#if OFFSET
    for (intptr_t row = 0; row < side; row++)
        for (intptr_t first = 0; first < wide; first += LANES) {
            Words sum = splat(0);
            for (int step = 0; step < STEPS; step++)
                sum = add_fours(sum, splat(0), words(reference + (row * STEPS + step) * wide +
                                                        first));
            *(WordsAnywhere *)(starts + row * wide + first) = -sum;
        }
#else
    (void)reference, (void)side, (void)wide, (void)starts; // there is no offset
#endif
}

// Write the products of each region of some rows with those at a displacement and to the right of
// it, times `unit`; images: [FIELD_SPAN][rows][wide], `apart` numbers apart. Values outside the
// shared part are undefined.
static inline void similarities(const int32_t *query, const int32_t *reference,
                                const int32_t *starts, intptr_t wide, Part part, intptr_t down,
                                intptr_t right, float unit, float *images, intptr_t apart)
{
    for (intptr_t row = part.top; row < part.bottom; row++)
        for (intptr_t first = 0; first < wide; first += LANES) {
            const int32_t *own = query + row * STEPS * wide + first;
            const int32_t *other = reference + (row + down) * STEPS * wide + first + right;
            const int32_t *start = starts + (row + down) * wide + first + right;
            Sums sums[FIELD_SPAN];
#pragma GCC unroll 9
            for (int one = 0; one < FIELD_SPAN; one++)
                sums[one] = begun(start + one);
            for (int step = 0; step < STEPS; step++, own += wide, other += wide) {
                Words here = words(own);
#pragma GCC unroll 9
                for (int one = 0; one < FIELD_SPAN; one++)
                    sums[one] = add_fours(sums[one], here, words(other + one));
            }
#pragma GCC unroll 9
            for (int one = 0; one < FIELD_SPAN; one++)
                store(images + one * apart + row * wide + first,
                      unit * __builtin_convertvector(whole(sums[one]), Floats));
        }
}

// Return the weighted sum of neighbours along a line.
INLINE Floats weighed(const float *line, intptr_t apart, const Floats *weights)
{
    Floats sum = weights[0] * floats(line - FIELD_RADIUS * apart);
#pragma GCC unroll 6
    for (int step = 1; step <= 2 * FIELD_RADIUS; step++)
        sum = fused(weights[step], floats(line + (step - FIELD_RADIUS) * apart), sum);
    return sum;
}

// Write 1 by the sum of the weights of a line's neighbours between first and end; 0 elsewhere.
static void write_shares(const float *weights, intptr_t first, intptr_t end, intptr_t count,
                         float *shares)
{
    for (intptr_t place = 0; place < count; place++) {
        float sum = 0;
        for (intptr_t step = -FIELD_RADIUS; step <= FIELD_RADIUS; step++)
            sum += place + step >= first && place + step < end ? weights[step + FIELD_RADIUS] : 0;
        shares[place] = place >= first && place < end ? 1 / sum : 0;
    }
}

// Update the best similarities, and the displacements that gave them.
INLINE void keep_best(Floats numbers, int32_t which, float *best, int32_t *origin)
{
    Floats highest = floats(best);
    Words from = words(origin);
    keep_larger(numbers, splat(which), &highest, &from);
    store(best, highest);
    *(WordsAnywhere *)origin = from;
}

// The best similarity of each region so far, and the displacement that gave it.
typedef struct {
    float *number;
    int32_t *origin;
} Best;

// Write weighted means of the existing neighbours in a part of an image, which has zeros above and
// below; -infinity outside. They update the best of the query, and of the reference, whose regions
// lie `away`. shares: of rows and columns; lines: memory for rows that are `wide` + GAP apart, with
// zeros between. New values are read late, because vectors across two recent stores wait for
// memory.
static inline void smooth(const float *image, Part part, intptr_t wide, const float *weights,
                          const float *row_shares, const float *shares, float *lines,
                          float *smoothed, int32_t which, Best query, Best reference,
                          intptr_t away)
{
    Floats each[2 * FIELD_RADIUS + 1]; // in registers, else they are read again after every store
#pragma GCC unroll 7
    for (int step = 0; step <= 2 * FIELD_RADIUS; step++)
        each[step] = spread(weights[step]);
    for (intptr_t y = part.top; y < part.bottom; y++)
        for (intptr_t x = 0; x < wide; x += LANES) {
            Words shared = floats(shares + x) > 0;
            Floats mean = row_shares[y] * weighed(image + y * wide + x, wide, each);
            store(lines + y * (wide + GAP) + x, (Floats)((Words)mean & shared));
        }
    for (intptr_t y = part.top; y < part.bottom; y++)
        for (intptr_t x = 0; x < wide; x += LANES) {
            intptr_t here = y * wide + x, there = here + away;
            Floats own = floats(shares + x);
            Words mean = (Words)(own * weighed(lines + y * (wide + GAP) + x, 1, each));
            Floats found = (Floats)chosen(own > 0, mean, (Words)spread(-INFINITY));
            store(smoothed + here, found);
            keep_best(found, which, query.number + here, query.origin + here);
            keep_best(found, which, reference.number + there, reference.origin + there);
        }
}

// Return the offset of the top of a parabola through three numbers from the middle one.
static inline float beside(float before, float middle, float after)
{
    float bend = before - 2 * middle + after;
    float off = bend < 0 ? (before - after) / 2 / bend : 0; // NaN where one is not known
    return off > -0.5f && off < 0.5f ? off : off >= 0.5f ? 0.5f : off <= -0.5f ? -0.5f : 0;
}

// Similarities by displacement and region of the query: volume[FIELD_SPAN][FIELD_SPAN][side][wide].
typedef struct {
    const float *volume;
    intptr_t side, wide, down, right; // the last two: what the first displacement is
} Volume;

static inline float similarity(const Volume *all, intptr_t i, intptr_t j, intptr_t y, intptr_t x,
                               int is_reference)
{
    intptr_t down = all->down + i, right = all->right + j, side = all->side;
    intptr_t row = is_reference ? y - down : y, column = is_reference ? x - right : x;
    int is_shared = is_within(row, side) & is_within(column, side) &
                    is_within(row + down, side) & is_within(column + right, side);
    if (!is_shared)
        return NAN;
    return all->volume[((i * FIELD_SPAN + j) * side + row) * all->wide + column];
}

// Fill in the subcell displacement; return 0 if there is none, or the best is on the border.
static inline int refined(const Volume *all, int32_t origin, intptr_t y, intptr_t x,
                          int is_reference, float moved[2])
{
    intptr_t i = origin / FIELD_SPAN, j = origin % FIELD_SPAN;
    if (origin < 0 || i == 0 || j == 0 || i == FIELD_SPAN - 1 || j == FIELD_SPAN - 1)
        return 0;
    float middle = similarity(all, i, j, y, x, is_reference);
    moved[0] = (float)(all->down + i) +
               beside(similarity(all, i - 1, j, y, x, is_reference), middle,
                      similarity(all, i + 1, j, y, x, is_reference));
    moved[1] = (float)(all->right + j) +
               beside(similarity(all, i, j - 1, y, x, is_reference), middle,
                      similarity(all, i, j + 1, y, x, is_reference));
    return 1;
}

// Fill in displacements found[n][5] that lead from a region to another and back, and their count.
//
// query, reference: bytes, four in a word, [side][8][wide], with `wide` + SPREAD words before and
// after; wide: `side` rounded up to SPREAD; a product of two bytes is multiplied by `unit`. The
// search covers displacements within FIELD_REACH of (down, right), which are less than `side`.
// weights[7]: of a region and its neighbours. Displacements that come back with an error above
// `tolerance` are left out. found: [side ** 2][5].
KERNEL(displacements)(const int32_t *query, const int32_t *reference, intptr_t side, intptr_t down,
                      intptr_t right, float unit, const float *weights, float tolerance,
                      float *found, int64_t *kept)
{
    enum { ALL = FIELD_SPAN * FIELD_SPAN };
    intptr_t wide = rounded_up(side, SPREAD), image = side * wide;
    intptr_t apart = image + 2 * FIELD_RADIUS * wide, border = wide + SPREAD;
    // `best` and `which` have a margin around the image for displacements that leave it.
    intptr_t count = image + 2 * border;
    intptr_t between = (side + 1) * (wide + GAP);
    size_t needed = (size_t)(ALL * image + FIELD_SPAN * (apart + wide) + between + wide + 5 * count);
    float *volume = malloc(needed * sizeof *volume);
    if (!volume)
        return -1;
    float *images = volume + ALL * image, *lines = images + FIELD_SPAN * apart;
    float *row_shares = lines + between, *shares = row_shares + wide;
    float *best = shares + FIELD_SPAN * wide, *back = best + count;
    int32_t *origin = (int32_t *)(back + count), *back_origin = origin + count;
    int32_t *starts = back_origin + count;
    *kept = 0;
    memset(starts, 0, (size_t)count * sizeof *starts);
    memset(images, 0, (size_t)(FIELD_SPAN * apart + between) * sizeof *images);
    for (intptr_t place = 0; place < 2 * count; place++) {
        best[place] = -INFINITY;
        origin[place] = -1;
    }
    best += border, back += border, origin += border, back_origin += border, starts += border;
    write_starts(reference, side, wide, starts);
    Volume all = {volume, side, wide, down - FIELD_REACH, right - FIELD_REACH};
    for (intptr_t j = 0; j < FIELD_SPAN; j++) {
        Part part = overlap(side, 0, all.right + j);
        write_shares(weights, part.left, part.right, wide, shares + j * wide);
    }
    for (intptr_t i = 0; i < FIELD_SPAN; i++) {
        intptr_t lower = all.down + i;
        Part rows = overlap(side, lower, 0);
        if (rows.top >= rows.bottom)
            continue;
        write_shares(weights, rows.top, rows.bottom, wide, row_shares);
        float *raw = images + FIELD_RADIUS * wide;
        for (intptr_t j = 0; j < FIELD_SPAN; j++) { // zeros for the smoothing
            memset(raw + j * apart + (rows.top - FIELD_RADIUS) * wide, 0,
                   (size_t)(FIELD_RADIUS * wide) * sizeof *raw);
            memset(raw + j * apart + rows.bottom * wide, 0,
                   (size_t)(FIELD_RADIUS * wide) * sizeof *raw);
        }
        similarities(query, reference, starts, wide, rows, lower, all.right, unit, raw, apart);
        for (intptr_t j = 0; j < FIELD_SPAN; j++) {
            int32_t which = (int32_t)(i * FIELD_SPAN + j);
            intptr_t further = all.right + j;
            Part part = overlap(side, lower, further);
            if (part.left >= part.right)
                continue;
            float *own = volume + which * image;
            smooth(raw + j * apart, part, wide, weights, row_shares, shares + j * wide, lines + GAP,
                   own, which, (Best){best, origin}, (Best){back, back_origin},
                   lower * wide + further);
        }
    }
    for (intptr_t y = 0; y < side; y++)
        for (intptr_t x = 0; x < side; x++) {
            float there[2], from[2];
            if (!refined(&all, origin[y * wide + x], y, x, 0, there))
                continue;
            intptr_t row = (intptr_t)floorf((float)y + there[0] + 0.5f);
            intptr_t column = (intptr_t)floorf((float)x + there[1] + 0.5f);
            if (row < 0 || row >= side || column < 0 || column >= side ||
                !refined(&all, back_origin[row * wide + column], row, column, 1, from))
                continue;
            float rows = there[0] - from[0], columns = there[1] - from[1];
            if (rows * rows + columns * columns > tolerance * tolerance)
                continue;
            float *facts = found + FACTS * (*kept)++;
            facts[0] = (float)y, facts[1] = (float)x;
            facts[2] = there[0], facts[3] = there[1];
            facts[4] = best[y * wide + x];
        }
    free(volume);
    return 0;
}

// The values of displacements, one array each; padding up to full vectors has no weight.
typedef struct {
    intptr_t count;
    double *y, *x, *moved[2], *counts; // y, x: in sides from the middle
} Columns;

// Write the squared errors of displacements under a motion, in cells.
INLINE Doubles off_squared(const Columns *all, intptr_t place, const double *motion)
{
    Doubles y = doubles(all->y + place), x = doubles(all->x + place);
    Doubles rows = doubles(all->moved[0] + place) - (motion[0] + motion[1] * y + motion[2] * x);
    Doubles columns = doubles(all->moved[1] + place) - (motion[3] + motion[4] * y + motion[5] * x);
    return rows * rows + columns * columns;
}

// Improve a motion by least squares, with weights from the errors under the current motion.
static void fit_again(const Columns *all, double by_sigma, double stiff, double motion[6])
{
    enum { SUMS = 12, AT_ONCE = 8, PARTS = 2 * AT_ONCE / LANES };
    Doubles sums[SUMS][PARTS] = {0};
    for (intptr_t first = 0; first < all->count; first += AT_ONCE)
#pragma GCC unroll 4
        for (int part = 0; part < PARTS; part++) { // the same 8 sums on all processors
            intptr_t place = first + part * LANES / 2;
            Doubles weight = 1 / (1 + by_sigma * off_squared(all, place, motion));
            weight *= weight * doubles(all->counts + place);
            Doubles y = doubles(all->y + place), x = doubles(all->x + place);
            Doubles by_y = weight * y, by_x = weight * x;
            sums[0][part] += weight, sums[1][part] += by_y, sums[2][part] += by_x;
            sums[3][part] += by_y * y, sums[4][part] += by_y * x, sums[5][part] += by_x * x;
#pragma GCC unroll 2
            for (int axis = 0; axis < 2; axis++) {
                Doubles moved = doubles(all->moved[axis] + place);
                sums[6 + 3 * axis][part] += weight * moved;
                sums[7 + 3 * axis][part] += by_y * moved, sums[8 + 3 * axis][part] += by_x * moved;
            }
        }
    double total[SUMS] = {1e-6, 0, 0, stiff, 0, stiff};
    for (int sum = 0; sum < SUMS; sum++)
        for (int lane = 0; lane < AT_ONCE; lane++)
            total[sum] += sums[sum][lane / (LANES / 2)][lane % (LANES / 2)];
    double a = total[0], b = total[1], c = total[2], d = total[3], e = total[4], f = total[5];
    // The inverse of a symmetric matrix ((a, b, c), (b, d, e), (c, e, f)).
    double aa = d * f - e * e, ab = c * e - b * f, ac = b * e - c * d;
    double bb = a * f - c * c, bc = b * c - a * e, cc = a * d - b * b;
    double whole = a * aa + b * ab + c * ac;
    for (int axis = 0; axis < 2; axis++) {
        double *own = motion + 3 * axis, *sum = total + 6 + 3 * axis;
        own[0] = (aa * sum[0] + ab * sum[1] + ac * sum[2]) / whole;
        own[1] = (ab * sum[0] + bb * sum[1] + bc * sum[2]) / whole;
        own[2] = (ac * sum[0] + bc * sum[1] + cc * sum[2]) / whole;
    }
}

// Fit motion[2][3] to displacements found[count][5]: rows and columns moved are each affine in
// (1, row, column), measured from the middle in sides. In each round an error of `sigma` cells has
// a weight of a quarter; `stiff`: weight of the prior for no slope. Fill in the errors `off`.
KERNEL(fit_motion)(const float *found, intptr_t count, intptr_t side, double sigma,
                   intptr_t rounds, double stiff, double *motion, double *off)
{
    intptr_t room = rounded_up(count, 8);
    double middle = (double)(side - 1) / 2, *numbers = calloc((size_t)(5 * room + 8), sizeof *off);
    Columns all = {room, numbers, numbers + room, {numbers + 2 * room, numbers + 3 * room},
                   numbers + 4 * room};
    if (!numbers)
        return -1;
    for (intptr_t one = 0; one < count; one++) {
        const float *facts = found + FACTS * one;
        all.y[one] = (facts[0] - middle) / (double)side, all.x[one] = (facts[1] - middle) /
                                                                      (double)side;
        all.moved[0][one] = facts[2], all.moved[1][one] = facts[3], all.counts[one] = 1;
    }
    for (intptr_t round = 0; round < rounds; round++)
        fit_again(&all, 1 / (sigma * sigma), stiff, motion);
    for (intptr_t first = 0; first < count; first += LANES / 2) {
        Doubles squared = off_squared(&all, first, motion);
        for (intptr_t lane = 0; lane < LANES / 2 && first + lane < count; lane++)
            off[first + lane] = sqrt(squared[lane]);
    }
    free(numbers);
    return 0;
}

// Write the verification of a query with each reference, [several][9]: inliers, strength, the
// part of it from the query's upper half, and the motion [2][3]; `shifts`: common shifts,
// [several][2]; the rest is as in `displacements` and `fit_motion`.
KERNEL(verify)(const int32_t *query, const int32_t *const *references, intptr_t several,
               intptr_t side, const int64_t *shifts, float unit, const float *weights,
               float tolerance, double sigma, intptr_t rounds, double stiff, double (*judged)[9])
{
    intptr_t all = side * side;
    double *off = malloc((size_t)all * (sizeof *off + FACTS * sizeof(float)));
    float *found = (float *)(off + all);
    int failed = !off;
    for (intptr_t one = 0; one < several && !failed; one++) {
        const int64_t *shift = shifts + 2 * one;
        double motion[6] = {(double)shift[0], 0, 0, (double)shift[1], 0, 0}, sums[2] = {0};
        int64_t kept = 0, inliers = 0;
        failed |= CALL(displacements)(query, references[one], side, shift[0], shift[1], unit,
                                      weights, tolerance, found, &kept);
        failed |= CALL(fit_motion)(found, kept, side, sigma, rounds, stiff, motion, off);
        for (intptr_t place = 0; place < kept && !failed; place++) {
            const float *facts = found + FACTS * place;
            double each = facts[4] / (1 + off[place] * off[place] / (sigma * sigma));
            inliers += off[place] <= sigma;
            sums[0] += each;
            sums[1] += 2 * facts[0] < (float)side ? each : 0;
        }
        judged[one][0] = (double)inliers;
        for (int sum = 0; sum < 2; sum++)
            judged[one][1 + sum] = sums[sum] > 0 ? sums[sum] : 0;
        memcpy(judged[one] + 3, motion, sizeof motion);
    }
    free(off);
    return failed ? -1 : 0;
}
