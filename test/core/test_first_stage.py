# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Any function from an image to a vector is a first stage; maps are of one, with its vectors."""

from dataclasses import replace

from convseq_ros import build_map, Config, Frame, open_map, PlaceRecognizer
from convseq_ros.app.map_builder import link_map
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import EVERY_FRAME, with_values
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import ConfigError, MapError, ModelError
import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.once

CONFIG = with_values(Config(keyframes=EVERY_FRAME), {'image_size_px': 256})
ONLINE = with_values(CONFIG, {'mode': 'online'})
COUNT = 40


def small(image):
    """Return a copy of an image of 8 x 6 px, less its mean."""
    tiny = cv2.resize(image.astype(np.float32), (8, 6), interpolation=cv2.INTER_AREA)
    return tiny - tiny.mean()


@pytest.fixture
def frames(image):
    """Return a maker of the frames of a drive, by a seed."""
    return lambda seed=0, count=COUNT: [
        Frame((index + 1) * 10**8, image(index, seed)) for index in range(count)
    ]


def found(built, drive, **more):
    """Return the places that are accepted along a drive."""
    recognizer = PlaceRecognizer(built, CONFIG, **more)
    matches = [recognizer.process(frame) for frame in drive]
    assert all(one.accepted.inliers for one in matches if one.accepted)
    return [one.accepted.reference_index for one in matches if one.accepted]


def test_a_callable_descriptor_finds_places_and_geometry_verifies_them(frames):
    built = build_map(frames(), None, CONFIG, describe=small)
    assert built.global_descriptors.shape == (COUNT, 48)
    places = found(built, frames(1), describe=small)
    assert len(places) > 0.8 * COUNT and places == sorted(places)


@pytest.mark.parametrize('scale', [1e-25, 1e25])
def test_a_vector_of_any_scale_gets_unit_length(frames, scale):
    built = build_map(frames(0, 1), None, CONFIG, describe=lambda image: scale * small(image))
    assert np.linalg.norm(built.global_descriptors[0]) == pytest.approx(1, abs=1e-3)


def test_vectors_outlive_a_file_and_all_that_is_done_to_it(frames, tmp_path):
    first, second = tmp_path / 'a.db', tmp_path / 'b.db'
    for path, seed in ((first, 0), (second, 1)):
        build_map(frames(seed), path, CONFIG, describe=small)
    whole = open_map(first)
    rows = np.array([small(one.gray).ravel() for one in frames()])
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    assert whole.global_descriptors == pytest.approx(rows, abs=1e-3)
    save_map(joined([*slices_of(first), *slices_of(second)]), tmp_path / 'both.db', is_new=True)
    both = open_map(tmp_path / 'both.db')
    assert (both.global_descriptors[:COUNT] == whole.global_descriptors).all()
    assert [*link_map(both)] == [*range(COUNT, 2 * COUNT)]  # by their vectors, without the model
    assert len(both.links) > 0.8 * COUNT
    save_map(both, tmp_path / 'copy.db')
    assert (open_map(tmp_path / 'copy.db').global_descriptors == both.global_descriptors).all()
    # Who has no model reads what is built in.
    plain = open_map(first, CONFIG.encoding)
    assert plain.global_descriptors.shape == (COUNT, 252)
    expected = build_map(frames(), None, CONFIG).global_descriptors
    assert (plain.global_descriptors == expected).all()
    assert len(found(plain, frames(1))) > 0.8 * COUNT


def test_a_map_of_another_model_is_refused_in_one_line(frames, tmp_path):
    path, plain = tmp_path / 'map.db', tmp_path / 'plain.db'
    build_map(frames(count=20), path, CONFIG, describe=small)
    build_map(frames(count=20), plain, CONFIG)
    built_in = 'made with the built-in descriptor, asked for descriptor_model'

    def other(image):
        return small(image)[:3]

    for file, config, describe, told in (
        (path, CONFIG, other, 'descriptor_model'), (path, ONLINE, other, 'descriptor_model'),
        (path, ONLINE, None, 'descriptor_model'), (plain, CONFIG, small, built_in),
    ):  # fmt: skip
        with pytest.raises(MapError, match=told) as caught:
            Pipeline(file, config, describe=describe)
        assert '\n' not in str(caught.value)
    with pytest.raises(ConfigError, match='build the map again'):
        PlaceRecognizer(open_map(path), CONFIG, describe=other)
    named = replace(CONFIG, encoding=replace(CONFIG.encoding, descriptor_model='net.onnx'))
    with pytest.raises(ConfigError, match='is a file'):
        build_map([], None, named)


def test_places_are_added_with_vectors_to_a_map_that_grows(frames, tmp_path):
    path = tmp_path / 'map.db'
    pipeline = Pipeline(path, ONLINE, describe=small)
    for seed in (0, 1):
        for frame in frames(seed):
            last = replace(frame, stamp_ns=frame.stamp_ns + seed * 10**11)
            pipeline.cameras.process(last)
            pipeline.save()
    pipeline.close()
    grown = open_map(path)
    assert grown.global_descriptors.shape == (2 * COUNT, 48)
    assert len(grown.links) > 0.8 * COUNT


@pytest.mark.parametrize(
    ('wrong', 'line'),
    [
        (lambda _: [np.nan] * 4, 'holds NaN, or nothing'),
        (lambda _: [], 'holds NaN, or nothing'),
        (lambda _: [0.0] * 4, 'its vector is all zeros; check its output'),
        (lambda image: np.ones(4 + int(image.mean()) % 2), 'numbers, expected'),
    ],
)
def test_an_invalid_vector_is_reported_in_one_line(frames, wrong, line):
    with pytest.raises(ModelError, match=line) as caught:
        build_map(frames(), None, CONFIG, describe=wrong)
    assert '\n' not in str(caught.value)


def test_vectors_of_another_length_than_the_maps_are_refused(frames):
    class Changed:
        identity = small.__qualname__

        def __call__(self, image):
            return small(image)[:3]

    built = build_map(frames(count=5), None, CONFIG, describe=small)
    recognizer = PlaceRecognizer(built, CONFIG, describe=Changed())
    with pytest.raises(ModelError, match='24 numbers, expected 48'):
        recognizer.process(frames()[0])


def test_a_callable_gets_the_grey_image_upright_and_masked(image):
    mask, taken = np.full((60, 80), 255, np.uint8), []
    mask[:, :40] = 0
    encoding = replace(CONFIG.encoding, image_rotation_deg=180)
    config = masked(replace(CONFIG, encoding=encoding), mask)

    def keeps(image):
        taken.append(image)
        return small(image)

    gray = image(1)
    assert len(build_map([Frame(1, gray)], None, config, describe=keeps)) == 1
    assert taken[0].shape == (120, 160)
    assert (taken[0][:, :60] == np.rot90(gray, 2)[:, :60]).all()
    assert (taken[0][:, 100:] == 128).all()


def test_a_map_names_its_descriptor_model_unless_it_is_built_in(frames, tmp_path):
    for name, describe in (('plain', None), ('model', small)):
        build_map(frames(count=3), tmp_path / name, CONFIG, describe=describe)
    assert 'descriptor_model' not in MapReader(tmp_path / 'plain').about()['encoding']
    assert '#small' in MapReader(tmp_path / 'model').about()['encoding']
