# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled pair scores are those of the definitions."""

import os
from pathlib import Path
import sys

from convseq_ros.core import compiled
from convseq_ros.core.compiled import library, VARIANTS
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import projected_regions, unit
from convseq_ros.core.map.place import pack_cells, unpack_cells
from convseq_ros.core.retrieval import whitening
from convseq_ros.core.similarity.coherent import CoherentQuery, global_similarity, widened
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.similarity.kernels.numpy_coherent import less_background, NumpyCoherent
from convseq_ros.core.types import Descriptor
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from programs import needs_library, run
import pytest

INSTALLED_IN = Path(compiled.__file__).parents[2]  # which need not be the repository
DEFINITION = NumpyCoherent()


def drawn(seed, side=32, share=0.7):
    """Return a descriptor of which about a share is salient: smooth, as images are."""
    rng = np.random.default_rng(seed)
    smooth = cv2.GaussianBlur(rng.random((side + 8, side + 8, 8)), (0, 0), 1.0)[4:-4, 4:-4]
    cells = ((smooth - smooth.min()) ** 3 * 1e5).astype(np.float32)
    salient = np.zeros((side - 1) ** 2, bool)
    salient[rng.permutation(salient.size)[: max(1, round(share * salient.size))]] = True
    entropy = cv2.GaussianBlur(rng.random((side, side)), (0, 0), 1.0)
    box = cv2.boxFilter(entropy, -1, (3, 3))[1:-1, 1:-1]
    return Descriptor(cells, salient, entropy - np.quantile(box, 1 - share) + 4.0, 0.5)


def compiled_kernel():
    needs_library()
    return coherent_kernel()


@settings(deadline=None, max_examples=30)
@given(side=st.integers(4, 40), share=st.floats(0, 1), seed=st.integers(0, 1000))
def test_scores_agree_for_any_size_and_any_salient_share(side, share, seed):
    references, found = [drawn(seed + 1, side).cells, drawn(seed, side).cells], []
    for kernel in (compiled_kernel(), DEFINITION):
        features = kernel.extract(drawn(seed, side, share), 4.0 - 1e-6)
        prepared = [kernel.prepare(one, None) for one in references]
        found.append(kernel.compare(features, prepared)[0])
    # Projected numbers agree to 1e-6, so that now and then one is rounded to another byte.
    count = max(1, share * (side - 2) ** 2)
    assert np.abs(found[0] - found[1]).max() < 1e-3 + 3 / count


@settings(deadline=None, max_examples=30)
@given(
    side=st.integers(2, 20), share=st.floats(0.05, 1), seed=st.integers(0, 99),
    values=st.sampled_from([2, 9, 300]), step=st.sampled_from([1, 2]),
)  # fmt: skip
def test_of_the_same_regions_scores_and_shifts_are_equal(side, share, seed, values, step):
    """Also where products are equal, of which the last one counts."""
    kernels, rng = (compiled_kernel(), DEFINITION), np.random.default_rng(seed)
    numbers = rng.integers(-values, values + 1, (4, side**2, 32))
    query, *references = unit(numbers.astype(np.float32))
    references[0] = query
    index = np.sort(rng.permutation(side**2)[: max(1, round(share * side**2))])
    salient = CoherentQuery(query[index], index, side)
    results = []
    for kernel in kernels if step == 1 else [one.rough for one in kernels]:
        packed = [kernel.packed(one, None) for one in references]
        results.append(kernel.scores(kernel.laid_out(salient), None, packed))
    found, expected = results
    assert np.abs(found[0] - expected[0]).max() < 1e-6
    assert np.array_equal(found[1], expected[1])


@pytest.mark.parametrize('side', [3, 4, 5, 14, 15, 31, 32, 128])
def test_compiled_regions_are_those_of_the_definition(side):
    needs_library()
    from convseq_ros.core.encoding.kernels import project as projected

    cells = np.random.default_rng(side).random((side, side + 1, 8), np.float32)[:, 1:] ** 3
    cells[side // 2 :, : side // 2] = 0
    for scale in (1e-3, 1, 391_754):
        scaled = cells * np.float32(scale)
        found, expected = projected(scaled), projected_regions(scaled)
        assert found.shape == expected.shape and found.dtype == np.float32
        assert np.abs(found - expected).max() < 1e-6
    assert np.abs(projected(np.zeros_like(cells)) - projected_regions(0 * cells)).max() < 1e-6


@pytest.mark.parametrize('side', [3, 4, 7, 32])
def test_compiled_regions_less_their_background_are_those_of_the_definition(side):
    needs_library()
    from convseq_ros.core.similarity.kernels.coherent import less_background as compiled

    regions, background = (projected_regions(drawn(seed, side).cells) for seed in (1, 2))
    found, expected = (show(regions, background) for show in (compiled, less_background))
    assert np.abs(found[0] - expected[0]).max() < 2e-6
    assert np.abs(found[1] - expected[1]).max() <= 1
    assert compiled(regions, None)[1] is less_background(regions, None)[1] is None


@pytest.mark.parametrize('side', [3, 7, 32])
@pytest.mark.parametrize('subtracts', [False, True])
def test_many_references_are_prepared_as_one_is(side, subtracts):
    pair = compiled_kernel()
    background = projected_regions(drawn(0, side).cells) if subtracts else None
    packed = [pack_cells(drawn(seed, side).cells * (seed != 2)) for seed in range(1, 5)]
    found = pair.prepare_packed(packed, background)
    assert found[1] is None
    for one, made in zip(packed, found, strict=True):
        if made is not None:
            expected = pair.prepare(pair.normalize(unpack_cells(one)), background)
            assert made.blocks == expected.blocks and (made.blocks > 0) == subtracts
            panels = [one.panel.view(np.float32) for one in (made, expected)]
            end = made.blocks or len(panels[0])
            assert np.array_equal(*(one[:end].view(np.int32) for one in panels))
            assert np.abs(panels[0][end:] - panels[1][end:]).max(initial=0) <= 1


def test_compiled_global_similarities_are_those_of_the_definition():
    pair = compiled_kernel()
    from convseq_ros.core.similarity.kernels.coherent import _similarities as similarities

    rng = np.random.default_rng(3)
    for side in (1, 5, 30):
        count = -(-side // 3)
        drawn_blocks = rng.normal(0, 1, (4, count, count, 32)).astype(np.float32)
        blocks = [np.rint(one.ravel() * np.float32(2**17)) for one in drawn_blocks]
        regions = np.zeros((side**2, 32), np.float32)
        packed = [pair.packed(regions, one) for one in blocks]
        where = np.array([one.address for one in packed], np.uint64)
        wide = widened(blocks[0], side)
        found = similarities(wide, packed, where)
        assert np.array_equal(found, global_similarity(wide, np.array(blocks, np.float64)))
        assert found[0] == pytest.approx(1)
        bare = pair.packed(regions, None)
        assert similarities(wide, [packed[1], bare], where) is None


# Prints the kernels in use, and what must not depend on the processor, to the last bit.
ENCODE_AND_SCORE = """
import hashlib
import cv2
import numpy as np
from convseq_ros.core.compiled import library
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.retrieval.whitening import products

print(library().variant)

def told(*found):
    joined = b''.join(np.ascontiguousarray(one).tobytes() for one in found)
    print(hashlib.sha256(joined).hexdigest())

noise = np.random.default_rng(5).integers(0, 256, (6, 512, 512), np.uint8)
shown = [describe(cv2.GaussianBlur(one, (0, 0), 5)) for one in noise]
told(*(one.cells for one in shown))
kernel = coherent_kernel()
background = kernel.project(shown[5].cells)
own = kernel.subtract(kernel.project(shown[0].cells), background)
told(kernel.normalize(shown[0].cells), own[0])
packed = [pack_cells(one.cells) for one in shown[:5]]
query, many = kernel.extract(shown[0], 4.0, own), kernel.prepare_packed(packed, background)
told(*kernel.compare(query, many))
told(*kernel.compare(query, [kernel.prepare(one.cells, background) for one in shown[:5]]))
rows = np.random.default_rng(2).normal(0, 1, (100, 252)).astype(np.float16)
told(products(rows, rows[0].astype(np.float32)))
"""


def in_process(lines, **environment):
    result = run(sys.executable, '-c', lines, cwd=INSTALLED_IN, env={**os.environ, **environment})
    assert result.returncode == 0, result.stderr
    return result.stdout.split('\n')[:-1]


@pytest.mark.once
@pytest.mark.parametrize('variant', VARIANTS)
def test_kernels_of_every_instruction_set_give_identical_bits(variant):
    needs_library()
    tell = {one: getattr(library().functions, f'convseq_has_{one}', None) for one in VARIANTS}
    best, *others = (one for one in VARIANTS if tell[one] and tell[one]())
    if variant not in (best, *others):
        pytest.skip(f'this processor has no {variant}')
    (kind, *found), (_, *expected) = (
        in_process(ENCODE_AND_SCORE, CONVSEQ_KERNELS=each) for each in (variant, best)
    )
    assert kind == variant and len(expected) == 5
    assert found == expected


@pytest.mark.parametrize('numbers', [1, 12, 15, 16, 17, 31, 32, 252])
@pytest.mark.parametrize('compiled', [True, False])
def test_products_of_float16_rows_are_those_of_float64(numbers, compiled, monkeypatch):
    if compiled:
        needs_library()
    else:
        monkeypatch.setattr(whitening, 'available', lambda: False)
    rng = np.random.default_rng(numbers)
    rows = rng.normal(0, 1, (5000, numbers)).astype(np.float16)
    rows[:4] = np.array([0, 6e-8, -6e-5, 65504], np.float16)[:, None]
    direction = rng.normal(0, 1, numbers).astype(np.float32)
    found = whitening.products(rows, direction)
    expected = rows.astype(np.float64) @ direction
    size = np.abs(rows.astype(np.float64)) @ np.abs(direction)
    assert found.dtype == np.float32
    assert (np.abs(found - expected) <= 1e-6 * size).all()
    assert whitening.products(rows[:0], direction).shape == (0,)


def test_rough_scores_are_those_of_the_definition(image):
    described = [describe(image(place)) for place in (3, 3, 8)]
    background, found = projected_regions(described[2].cells), []
    for pair in (compiled_kernel().rough, DEFINITION.rough):
        shown = pair.subtract(pair.project(described[0].cells), background)
        query = pair.extract(described[0], 0.0, shown)
        references = [pair.prepare(one.cells, background) for one in described[:2]]
        found.append(pair.compare(query, references)[0])
    assert found[1][0] > 0.9
    assert np.allclose(*found, atol=0.02)


def test_regions_of_a_prepared_reference_are_recovered_as_bytes(image):
    cells, found = describe(image(3)).cells, []
    for pair in (compiled_kernel(), DEFINITION):
        regions = pair.subtract(pair.project(cells), None)[0]
        found.append(pair.regions_of(pair.prepare(cells, None)))
        assert np.allclose(found[-1], regions, atol=0.6 / 160)
    assert np.mean(found[0] != found[1]) < 1e-3
