// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// Between stored cells and numbers.

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
