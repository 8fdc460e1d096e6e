# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The paper's method restated step by step in plain loops, float64: slow, and easy to check by eye.

It shares no code with the package. `regenerate.py` stores what it computes.
"""

import math

import cv2
import numpy as np

SIZE, CELL, BINS, GRID = 512, 16, 8, 32


def drawn_images(count, seed, shift_px=0):
    """Return grey pictures along one drawn street, each a step further than the one before."""
    rng = np.random.default_rng(seed)
    length = 160 * count + 320 + shift_px
    street = np.full((240, length), 128.0)
    for start in range(0, length, 80):
        stretch = rng.normal(size=(240, 80))
        blur = rng.choice([0.8, 3.0, 9.0], 2)
        stretch = cv2.GaussianBlur(stretch, (0, 0), blur[0], sigmaY=blur[1])
        part = street[:, start : start + 80]
        part += (stretch / stretch.std() * rng.choice([2, 9, 45]))[:, : part.shape[1]]
    street = street.clip(0, 255).astype(np.uint8)
    starts = [160 * index + shift_px for index in range(count)]
    return [street[:, start : start + 320].copy() for start in starts]


def cells_of(image):
    """Return (32, 32, 8) orientation histograms."""
    resized = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    corrected = np.sqrt(resized / float(resized.max())) * 255
    gx = cv2.Sobel(corrected, cv2.CV_64F, 1, 0, ksize=5)
    gy = cv2.Sobel(corrected, cv2.CV_64F, 0, 1, ksize=5)
    cells = np.zeros((GRID, GRID, BINS))
    for y in range(SIZE):
        for x in range(SIZE):
            strength = abs(0.5 * gx[y, x] + 0.5 * gy[y, x])
            angle = math.degrees(math.atan2(gy[y, x], gx[y, x])) % 360
            position = angle / 45
            lower = int(position)
            share = position - lower
            cells[y // CELL, x // CELL, lower % BINS] += strength * (1 - share)
            cells[y // CELL, x // CELL, (lower + 1) % BINS] += strength * share
    return cells


def entropy_map_of(image):
    """Return the (512, 512) local entropy in bits."""
    resized = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    small = cv2.resize(resized, (100, 100), interpolation=cv2.INTER_LINEAR)
    disk = [(y, x) for y in range(-5, 6) for x in range(-5, 6) if y * y + x * x <= 25]
    bits = np.zeros((100, 100))
    for y in range(100):
        for x in range(100):
            pixels = [
                small[y + dy, x + dx] for dy, dx in disk if 0 <= y + dy < 100 and 0 <= x + dx < 100
            ]
            counts = np.bincount(pixels)
            shares = counts[counts > 0] / len(pixels)
            bits[y, x] = -(shares * np.log2(shares)).sum()
    return cv2.resize(bits, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)


def salient_in(bits, threshold):
    """Return which of the 961 regions have a mean entropy of threshold * 8 bits."""
    return np.array(
        [
            bits[16 * r : 16 * r + 32, 16 * c : 16 * c + 32].mean() >= threshold * 8
            for r in range(31)
            for c in range(31)
        ]
    )


def regions_of(cells):
    """Return (961, 32) unit vectors."""
    rows = []
    for r in range(31):
        for c in range(31):
            four = [cells[r, c], cells[r, c + 1], cells[r + 1, c], cells[r + 1, c + 1]]
            joined = np.concatenate(four)
            length = math.sqrt((joined**2).sum())
            rows.append(joined / length if length else joined)
    return np.array(rows)


def pair_score(query_regions, salient, reference_regions):
    """Return the mean over the salient regions of the best similarity."""
    best = [
        max(float(region @ other) for other in reference_regions)
        for region, wanted in zip(query_regions, salient, strict=True)
        if wanted
    ]
    return sum(best) / len(best)


def length_at(anchor, similarities, entropies, overlap=0.9, least_entropy=0.5):
    """Return k for a frame and those before it, or None while too few are known."""
    k = 2
    while k <= anchor + 1 and k < 15 and similarities[anchor][anchor - k + 1] >= overlap:
        k += 1
    while k <= anchor + 1 and k < 25:
        if np.mean([entropies[anchor - i] for i in range(k)]) > least_entropy:
            break
        k += 1
    return k if k <= anchor + 1 else None


def sequence_score(scores, query, reference, k):
    """Return the mean along the diagonal that ends at a query and a reference."""
    return sum(scores[query - i][reference - i] for i in range(k)) / k
