# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept on disk between runs."""

from convseq_ros.evaluation.cache import Cache, content_digest
import numpy as np

ARRAYS = {'a': np.arange(3), 'names': np.array(['x', 'yy'])}


def test_what_was_put_is_got_by_the_same_facts_only(tmp_path):
    cache = Cache(tmp_path)
    cache.put('kind', ['facts', 1], ARRAYS)
    found = cache.get('kind', ['facts', 1])
    assert found['a'].tolist() == [0, 1, 2]
    assert found['names'].tolist() == ['x', 'yy']
    assert cache.get('kind', ['facts', 2]) is None
    assert cache.get('other', ['facts', 1]) is None


def test_a_damaged_file_counts_as_absent(tmp_path):
    cache = Cache(tmp_path)
    cache.put('kind', 'facts', ARRAYS)
    (path,) = (tmp_path / 'kind').iterdir()
    whole = path.read_bytes()
    for damaged in (b'', b'no zip', whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        assert cache.get('kind', 'facts') is None


def test_another_program_starts_anew(tmp_path, monkeypatch):
    cache = Cache(tmp_path)
    cache.put('kind', 'facts', ARRAYS)
    monkeypatch.setattr('convseq_ros.evaluation.cache.program_digest', lambda: 'other')
    assert cache.get('kind', 'facts') is None


def test_without_a_folder_nothing_is_kept():
    cache = Cache(None)
    cache.put('kind', 'facts', ARRAYS)
    assert cache.get('kind', 'facts') is None


def test_a_folder_is_known_by_names_and_bytes(tmp_path):
    (tmp_path / 'a').write_bytes(b'1')
    first = content_digest(tmp_path)
    assert content_digest(tmp_path) == first
    (tmp_path / 'a').write_bytes(b'2')
    assert content_digest(tmp_path) != first
    (tmp_path / 'a').write_bytes(b'1')
    (tmp_path / 'a').rename(tmp_path / 'b')
    assert content_digest(tmp_path) != first
