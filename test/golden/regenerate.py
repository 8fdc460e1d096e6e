# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Make drawn_street.npz anew: `python test/golden/regenerate.py` (a minute)."""

from pathlib import Path

import numpy as np
from restatement import (
    cells_of,
    drawn_images,
    entropy_map_of,
    length_at,
    pair_score,
    regions_of,
    salient_in,
    sequence_score,
)

COUNT = 8


def main():
    """Compute everything with the restatement and store it."""
    queries, references = drawn_images(COUNT, 2, shift_px=6), drawn_images(COUNT, 2)
    query_cells = [cells_of(image) for image in queries]
    bits = [entropy_map_of(image) for image in queries]
    salient = [salient_in(each, 0.5) for each in bits]
    entropies = [each.mean() / 8 for each in bits]
    query_regions = [regions_of(cells) for cells in query_cells]
    reference_regions = [regions_of(cells_of(image)) for image in references]

    def scores_against(others):
        return np.array(
            [
                [pair_score(own, mask, other) for other in others]
                for own, mask in zip(query_regions, salient, strict=True)
            ]
        )

    scores, similarities = scores_against(reference_regions), scores_against(query_regions)
    lengths = [length_at(index, similarities, entropies) or 0 for index in range(COUNT)]
    sequence_scores = np.zeros((COUNT, COUNT))
    for query, k in enumerate(lengths):
        for reference in range(k - 1 if k else COUNT, COUNT):
            sequence_scores[query, reference] = sequence_score(scores, query, reference, k)
    np.savez_compressed(
        Path(__file__).parent / 'drawn_street.npz',
        cells=query_cells[0].astype(np.float32),
        bits=bits[0][::16, ::16],
        salient=salient,
        entropies=entropies,
        scores=scores,
        similarities=similarities,
        lengths=lengths,
        sequence_scores=sequence_scores,
    )
    print('lengths', lengths)
    print(scores.round(3))


if __name__ == '__main__':
    main()
