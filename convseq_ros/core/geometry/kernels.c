// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Where the regions of one image lie in another, and which of them moved alike.

enum {
    SPREAD = 32, // columns at a time; their sums stay in registers
    VECTORS = SPREAD / LANES,
    FACTS = 5, // of a displacement: row, column, rows and columns moved, similarity
};

typedef struct {
    intptr_t top, bottom, left, right; // the last two of each before which it ends
} Part;

// What of the query lies in the reference as well when everything has moved.
static inline Part overlap(intptr_t side, intptr_t down, intptr_t right)
{
    Part part = {down < 0 ? -down : 0, down > 0 ? side - down : side,
                 right < 0 ? -right : 0, right > 0 ? side - right : side};
    return part;
}

// The products of each region with the one that lies so far away; images [side][32][side], and 32
// numbers behind them that count for nothing. Rows of what is found begin where the part does.
static inline void similarities(const float *query, const float *reference, intptr_t side,
                                intptr_t down, intptr_t right, Part part, intptr_t wide,
                                float *image)
{
    for (intptr_t row = part.top; row < part.bottom; row++) {
        const float *here = query + row * NUMBERS * side + part.left;
        const float *there = reference + (row + down) * NUMBERS * side + part.left + right;
        for (intptr_t first = 0; first < part.right - part.left; first += SPREAD) {
            const float *one = here + first, *other = there + first;
            Floats sums[VECTORS] = {0};
            for (int number = 0; number < NUMBERS; number++, one += side, other += side)
#pragma GCC unroll 8
                for (int part = 0; part < VECTORS; part++)
                    sums[part] += floats(one + part * LANES) * floats(other + part * LANES);
#pragma GCC unroll 8
            for (int part = 0; part < VECTORS; part++)
                store(image + row * wide + first + part * LANES, sums[part]);
        }
    }
}

// Add up lines, one weight each.
static inline Floats weighed(const float *line, intptr_t apart, intptr_t count,
                             const float *weights)
{
    Floats sum = {0};
    for (intptr_t step = 0; step < count; step++)
        sum += weights[step] * floats(line + step * apart);
    return sum;
}

// Return numbers of the columns before `count`, and another one instead of those behind.
static inline Floats before(Floats numbers, intptr_t first, intptr_t count, float behind)
{
    Words is_before = *(const WordsAnywhere *)TURNED < (int32_t)(count - first);
    return (Floats)chosen(is_before, (Words)numbers, (Words)spread(behind));
}

// Replace each number of a part by the weighted mean around it, of those that there are; -infinity
// behind it. room: [side][wide + 2 * radius], zeros beside the image, and [wide] for the norms.
static inline void smooth(float *image, intptr_t side, Part part, intptr_t wide,
                          const float *weights, intptr_t radius, float *room)
{
    intptr_t framed = wide + 2 * radius, count = part.right - part.left;
    float *norms = room + side * framed;
    for (intptr_t x = 0; x < wide; x++) {
        norms[x] = x < count ? 0 : 1;
        for (intptr_t step = -radius; step <= radius && x < count; step++)
            if (x + step >= 0 && x + step < count)
                norms[x] += weights[step + radius];
    }
    for (intptr_t y = part.top; y < part.bottom; y++) {
        intptr_t top = y - radius < part.top ? part.top : y - radius;
        intptr_t bottom = y + radius < part.bottom ? y + radius + 1 : part.bottom;
        const float *own = weights + top - y + radius;
        float norm = 0;
        for (intptr_t step = 0; step < bottom - top; step++)
            norm += own[step];
        for (intptr_t x = 0; x < wide; x += LANES) {
            Floats sum = {0};
            if (x < count)
                sum = before(weighed(image + top * wide + x, wide, bottom - top, own), x, count, 0);
            store(room + y * framed + radius + x, sum / norm);
        }
    }
    for (intptr_t y = part.top; y < part.bottom; y++)
        for (intptr_t x = 0; x < count; x += LANES) {
            Floats sum = weighed(room + y * framed + x, 1, 2 * radius + 1, weights);
            store(image + y * wide + x, before(sum / floats(norms + x), x, count, -INFINITY));
        }
}

// Take a row of similarities into the best so far, and which displacement gave them.
static inline void keep_best(const float *line, intptr_t count, int32_t which, float *best,
                             int32_t *origin)
{
    for (intptr_t x = 0; x < count; x += LANES) {
        Floats highest = floats(best + x);
        Words from = *(const WordsAnywhere *)(origin + x);
        keep_larger(floats(line + x), splat(which), &highest, &from);
        store(best + x, highest);
        *(WordsAnywhere *)(origin + x) = from;
    }
}

// How far beside the middle of three numbers the top of a parabola through them lies.
static inline float beside(float before, float middle, float after)
{
    float bend = before - 2 * middle + after;
    float off = bend < 0 ? (before - after) / 2 / bend : 0; // NaN where one is not known
    return off > -0.5f && off < 0.5f ? off : off >= 0.5f ? 0.5f : off <= -0.5f ? -0.5f : 0;
}

// What all displacements say: volume[span][span][side][wide] by the place in the query, where rows
// begin with what lies in the reference as well.
typedef struct {
    const float *volume;
    intptr_t side, wide, span, down, right; // the last two: what the first displacement is
} Volume;

static inline float similarity(const Volume *all, intptr_t i, intptr_t j, intptr_t y, intptr_t x,
                               int is_reference)
{
    intptr_t down = all->down + i, right = all->right + j, side = all->side;
    intptr_t row = is_reference ? y - down : y, column = is_reference ? x - right : x;
    Part part = overlap(side, down, right);
    if (row < part.top || row >= part.bottom || column < part.left || column >= part.right)
        return NAN;
    return all->volume[((i * all->span + j) * side + row) * all->wide + column - part.left];
}

// Fill in rows and columns moved, between cells; return 0 if the best is none, or on the border.
static inline int refined(const Volume *all, int32_t origin, intptr_t y, intptr_t x,
                          int is_reference, float moved[2])
{
    intptr_t i = origin / all->span, j = origin % all->span;
    if (origin < 0 || i == 0 || j == 0 || i == all->span - 1 || j == all->span - 1)
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
// query, reference: [side][32][side], and 32 numbers more. Displacements within `reach` of (down,
// right) are searched; weights[2 * radius + 1]: of a region's neighbours on either side, and its
// own. What comes back further than `tolerance` off is left out. found: [side ** 2][5].
KERNEL(displacements)(const float *query, const float *reference, intptr_t side, intptr_t down,
                      intptr_t right, intptr_t reach, const float *weights, intptr_t radius,
                      float tolerance, float *found, int64_t *kept)
{
    intptr_t span = 2 * reach + 1, wide = rounded_up(side, SPREAD);
    // Best and which, there and back, and what is written behind the last row, unchanged.
    intptr_t count = side * side + SPREAD, framed = side * (wide + 2 * radius);
    size_t needed = (size_t)(span * span * side * wide + framed + wide + 4 * count);
    float *volume = malloc(needed * sizeof *volume);
    if (!volume)
        return -1;
    float *room = volume + span * span * side * wide, *best = room + framed + wide;
    int32_t *origin = (int32_t *)(best + 2 * count);
    *kept = 0;
    memset(room, 0, (size_t)framed * sizeof *room);
    for (intptr_t place = 0; place < 2 * count; place++) {
        best[place] = -INFINITY;
        origin[place] = -1;
    }
    Volume all = {volume, side, wide, span, down - reach, right - reach};
    for (intptr_t which = 0; which < span * span; which++) {
        intptr_t lower = all.down + which / span, further = all.right + which % span;
        Part part = overlap(side, lower, further);
        if (part.top >= part.bottom || part.left >= part.right)
            continue;
        float *image = volume + which * side * wide;
        similarities(query, reference, side, lower, further, part, wide, image);
        smooth(image, side, part, wide, weights, radius, room);
        for (intptr_t y = part.top; y < part.bottom; y++) {
            intptr_t here = y * side + part.left, there = count + here + lower * side + further;
            intptr_t columns = part.right - part.left;
            keep_best(image + y * wide, columns, (int32_t)which, best + here, origin + here);
            keep_best(image + y * wide, columns, (int32_t)which, best + there, origin + there);
        }
    }
    for (intptr_t y = 0; y < side; y++)
        for (intptr_t x = 0; x < side; x++) {
            float there[2], back[2];
            if (!refined(&all, origin[y * side + x], y, x, 0, there))
                continue;
            intptr_t row = (intptr_t)floorf((float)y + there[0] + 0.5f);
            intptr_t column = (intptr_t)floorf((float)x + there[1] + 0.5f);
            if (row < 0 || row >= side || column < 0 || column >= side ||
                !refined(&all, origin[count + row * side + column], row, column, 1, back))
                continue;
            float rows = there[0] - back[0], columns = there[1] - back[1];
            if (rows * rows + columns * columns > tolerance * tolerance)
                continue;
            float *facts = found + FACTS * (*kept)++;
            facts[0] = (float)y, facts[1] = (float)x;
            facts[2] = there[0], facts[3] = there[1];
            facts[4] = best[y * side + x];
        }
    free(volume);
    return 0;
}

// Fit motion[2][3] to displacements found[count][5]: rows and columns moved are each affine in
// (1, row, column), counted from the middle in sides. In each round what lies `sigma` off, in
// cells, counts a quarter; `stiff`: weight of no slope. Fill in how far each is off.
KERNEL(fit_motion)(const float *found, intptr_t count, intptr_t side, double sigma,
                   intptr_t rounds, double stiff, double *motion, double *off)
{
    double middle = (double)(side - 1) / 2;
    for (intptr_t round = 0; round <= rounds; round++) {
        double a = 1e-6, b = 0, c = 0, d = stiff, e = 0, f = stiff, sums[2][3] = {{0}};
        for (intptr_t one = 0; one < count; one++) {
            const float *facts = found + FACTS * one;
            double y = (facts[0] - middle) / (double)side, x = (facts[1] - middle) / (double)side;
            double rows = facts[2] - (motion[0] + motion[1] * y + motion[2] * x);
            double columns = facts[3] - (motion[3] + motion[4] * y + motion[5] * x);
            double squared = rows * rows + columns * columns;
            off[one] = sqrt(squared);
            double weight = 1 / (1 + squared / (sigma * sigma));
            weight *= weight;
            a += weight, b += weight * y, c += weight * x;
            d += weight * y * y, e += weight * y * x, f += weight * x * x;
            for (int axis = 0; axis < 2; axis++) {
                double moved = weight * facts[2 + axis];
                sums[axis][0] += moved, sums[axis][1] += moved * y, sums[axis][2] += moved * x;
            }
        }
        if (round == rounds)
            break;
        // The inverse of a symmetric matrix ((a, b, c), (b, d, e), (c, e, f)).
        double aa = d * f - e * e, ab = c * e - b * f, ac = b * e - c * d;
        double bb = a * f - c * c, bc = b * c - a * e, cc = a * d - b * b;
        double whole = a * aa + b * ab + c * ac;
        for (int axis = 0; axis < 2; axis++) {
            double *own = motion + 3 * axis, *sum = sums[axis];
            own[0] = (aa * sum[0] + ab * sum[1] + ac * sum[2]) / whole;
            own[1] = (ab * sum[0] + bb * sum[1] + bc * sum[2]) / whole;
            own[2] = (ac * sum[0] + bc * sum[1] + cc * sum[2]) / whole;
        }
    }
    return 0;
}
