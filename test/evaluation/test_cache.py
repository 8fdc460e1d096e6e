# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors that are kept between runs."""

from convseq_ros.evaluation import images
from convseq_ros.evaluation.cache import Cache, Made
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.methods import make_method, parse_method
from convseq_ros.evaluation.query_answers import overridden
from convseq_ros.sources import open_source
import numpy as np
import pytest

MADE = Made({'names': ['a', '\udce4']}, {'rows': [np.eye(2), np.zeros((0, 2)), np.eye(1, 2) / 3]})


@pytest.fixture
def measured(street, quick, tmp_path, monkeypatch):
    """Return a function that measures: warnings, scores, and how often a drive was read."""

    def measured(cache=None, config=quick):
        read = []
        monkeypatch.setattr(images, 'open_source', lambda *a: read.append(a) or open_source(*a))
        data_set = open_data_set(str(street.file))
        material = open_material(data_set, config.encoding, config.reading, cache)
        names = 'seqslam', 'orb-bow', 'sift-vlad'
        methods = [make_method(parse_method(name), config) for name in names]
        scores = [method.rows(material).scores.tobytes() for method in methods]
        return material.query.warnings, scores, len(read)

    return measured


def test_a_second_run_reads_no_image_and_answers_the_same(measured, street, tmp_path):
    (street.folder / 'query' / '005.png').write_bytes(b'torn')
    cache = Cache(tmp_path, pytest.fail)
    _, scores, reads = measured()
    assert reads == 8
    assert measured(cache)[1:] == (scores, 8)
    warnings, *again = measured(cache)
    assert again == [scores, 0]
    assert len(warnings) == 1 and '1 of 24 images cannot be read' in warnings[0]


def test_other_images_settings_or_programs_are_read_again(
    measured, street, quick, tmp_path, monkeypatch
):
    cache = Cache(tmp_path, pytest.fail)
    measured(cache)
    (street.folder / 'query' / '005.png').write_bytes(b'torn')
    assert measured(cache)[-1] == 4
    assert measured(cache, overridden(quick, {'saliency_threshold': 0.3}))[-1] == 2
    monkeypatch.setattr(images, 'program', lambda: 'another')
    assert measured(cache)[-1] == 8


def test_kept_arrays_come_back_bit_for_bit(tmp_path):
    cache = Cache(tmp_path, pytest.fail)
    assert cache.once('key', lambda: MADE) is MADE
    facts, rows = cache.once('key', pytest.fail)
    assert facts == MADE.facts
    np.testing.assert_equal(rows, MADE.rows)
    assert cache.once('other key', lambda: Made({}, {'rows': [np.eye(1)]})).facts == {}


@pytest.mark.parametrize('damage', [
    lambda _: b'', lambda file: file[:-1], lambda file: file[:50], lambda _: b'\x80\x04K\x01.',
    lambda file: file.replace(np.eye(2).tobytes(), np.ones((2, 2)).tobytes()),
    lambda file: file.replace(b'k\0\0\0e\0\0\0y', b'k\0\0\0e\0\0\0x'),
])  # fmt: skip
def test_a_damaged_file_is_made_again(tmp_path, damage):
    told = []
    cache = Cache(tmp_path, told.append)
    cache.once('key', lambda: MADE)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    assert damage(whole) != whole
    file.write_bytes(damage(whole))
    assert cache.once('key', lambda: MADE) is MADE
    (line,) = told
    assert line.startswith(f'{file}: cannot be read (') and line.endswith('; it is made again')
    cache.once('key', pytest.fail)
    assert [*tmp_path.iterdir()] == [file]


def test_a_file_of_another_key_is_not_taken(tmp_path):
    told = []
    cache = Cache(tmp_path, told.append)
    cache.once('key', lambda: MADE)
    (file,) = tmp_path.iterdir()
    cache.once('other', lambda: MADE)
    (other,) = {*tmp_path.iterdir()} - {file}
    file.replace(other)
    assert cache.once('other', lambda: MADE) is MADE
    (line,) = told
    assert 'it is of other images or settings' in line
