// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Between stored cells and numbers.

// Fill in the bits [count][8] of stored cells [15][count]; see format.py.
KERNEL(join_bytes)(const uint8_t *stored, intptr_t count, uint16_t *halves)
{
    for (intptr_t cell = 0; cell < count; cell++) {
        unsigned last = 0;
        for (int bin = 0; bin < 7; bin++) {
            unsigned upper = stored[(8 + bin) * count + cell];
            halves[8 * cell + bin] = (uint16_t)((upper & 127) << 8 | stored[bin * count + cell]);
            last |= upper >> 7 << bin;
        }
        halves[8 * cell + 7] = (uint16_t)(last << 8 | stored[7 * count + cell]);
    }
    return 0;
}

// Fill in a multiple, a power of two, of finite numbers in half precision; exact.
KERNEL(widen)(const uint16_t *halves, intptr_t count, float scale, float *numbers)
{
    intptr_t place = 0;
    for (; place + LANES <= count; place += LANES)
        store(numbers + place, widened(halves + place) * scale);
    if (place < count) {
        uint16_t rest[LANES] = {0};
        float found[LANES];
        memcpy(rest, halves + place, (size_t)(count - place) * sizeof *rest);
        store(found, widened(rest) * scale);
        memcpy(numbers + place, found, (size_t)(count - place) * sizeof *found);
    }
    return 0;
}
