# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The index of large maps: what it names has its exact score, and is what matters."""

from dataclasses import replace
import sys

from convseq_ros.config import Config, EVERY_FRAME, MatchingConfig, SequenceConfig
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence import indexed
from convseq_ros.core.sequence.centred import Centred, sums_of, usual_of
from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError
from convseq_ros.online_config import OnlineConfig
import numpy as np
import pytest

COUNT, NUMBERS, LISTED = 3000, 251, 150
STARTS = np.array([0, 1000])
PLACES = 80


@pytest.fixture
def listed(monkeypatch):
    """Return a way to have fewer references listed."""
    return lambda most: monkeypatch.setattr(indexed, 'INDEX', replace(indexed.INDEX, listed=most))


@pytest.fixture(scope='module')
def reference_map(described):
    made = ReferenceMap(keyframes=EVERY_FRAME)
    for place in range(PLACES):
        made.add(Place(place), pack_cells(described(place).cells))
    return made


def drawn():
    """Return two sessions of descriptors, what is usual of them, and directions like some."""
    rng = np.random.default_rng(0)
    references = rng.normal(0.3, 0.1, (COUNT, NUMBERS))
    references[STARTS[1] :] += 0.2
    references = references.astype(np.float16)
    usual = usual_of(sums_of(references), COUNT)
    asked = np.arange(0, COUNT, 100)
    noise = rng.normal(0.0, 0.15, (len(asked), NUMBERS))
    directions = (references[asked] - usual.mean + noise).astype(np.float32)
    return references, usual, asked, directions


def test_what_is_listed_has_its_exact_score_and_the_mean_stays(listed):
    pytest.importorskip('faiss')
    listed(LISTED)
    references, usual, asked, directions = drawn()
    whole, some = (
        indexed.centred(usual, references, STARTS, above) for above in (COUNT, COUNT - 1)
    )
    assert type(whole) is Centred and type(some) is indexed.Indexed
    found = []
    for place, direction in zip(asked, directions, strict=True):
        exact, row = (one.row(references, STARTS, direction) for one in (whole, some))
        values, counts = np.unique(row, return_counts=True)
        assert counts.max() == COUNT - LISTED
        told = row != values[counts.argmax()]
        assert told[place] and (row[told] == exact[told]).all()
        assert row.mean(dtype=float) == pytest.approx(exact.mean(dtype=float), abs=1e-6)
        found.append(told[np.argsort(-exact)[:20]].mean())
    assert np.mean(found) > 0.99


def drive(reference_map, image, above):
    config = Config(
        matching=MatchingConfig(shortlist_length=12, index_above=above),
        sequence=SequenceConfig(fixed_length=5),
    )
    recognizer = PlaceRecognizer(reference_map, config)
    places = [*range(20, 45), *range(60, 75)]
    return [
        recognizer.process(Frame(index, image(place, seed=1)))
        for index, place in enumerate(places)
    ]


def test_answers_are_those_without_an_index(reference_map, image, listed):
    pytest.importorskip('faiss')
    exact = drive(reference_map, image, 0)
    listed(8)
    told = drive(reference_map, image, 1)
    assert any(match.reason == 'accepted' for match in exact)
    # Rivals may be others, and with them how sure an answer is.
    same = [
        (one.status, one.best and one.best.reference_index)
        == (other.status, other.best and other.best.reference_index)
        for one, other in zip(exact, told, strict=True)
    ]
    assert np.mean(same) >= 0.95
    listed(PLACES)
    assert [repr(one) for one in drive(reference_map, image, 1)] == [repr(one) for one in exact]


def test_without_faiss_a_line_says_what_to_do(reference_map, monkeypatch):
    monkeypatch.setitem(sys.modules, 'faiss', None)
    config = Config(matching=MatchingConfig(index_above=PLACES - 1))
    with pytest.raises(ConfigError, match=r'80 places.*pip install.* faiss-cpu.*index_above to 0'):
        PlaceRecognizer(reference_map, config)
    # As large as the bound, or a map that grows, needs none.
    PlaceRecognizer(reference_map, Config(matching=MatchingConfig(index_above=PLACES)))
    PlaceRecognizer(reference_map, replace(config, online=OnlineConfig(mode='online')))
