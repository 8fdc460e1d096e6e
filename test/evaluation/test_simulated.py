# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets that are drawn, drives that go backwards, and drives against their own past."""

from dataclasses import replace

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.bench import evaluate, Plan
from convseq_ros.evaluation.data_set import open_data_set, Part, SimulatedDrive
from convseq_ros.evaluation.images import Images
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.query_answers import recognize
from convseq_ros.io.files import make_record
import numpy as np
import pytest

DRAWN = """
name: drawn
query: {simulated: {street: 3, num_frames: 6, width_px: 64, height_px: 48, noise: 5}}
reference: {simulated: {street: 3, num_frames: 6, width_px: 64, height_px: 48, seed: 1}}
truth: {kind: identity, tolerance: 1}
"""


def test_a_drawn_set_needs_no_files_and_is_the_same_every_time(street, quick):
    material = open_material(open_data_set(str(street.write(DRAWN, 'drawn.yaml'))), quick.encoding)
    query, reference = material.drives(quick.encoding)
    assert (len(query), len(reference)) == (6, 6)
    first, second = (np.stack([one.gray for one in material.query]) for _ in range(2))
    assert first.shape == (6, 48, 64) and (first == second).all()
    assert (first != np.stack([one.gray for one in material.reference])).any()
    assert query.stamps_ns[1] - query.stamps_ns[0] == 100_000_000


def test_the_settings_of_a_drawn_set_change_its_checksum(tmp_path):
    one, same, other = (
        Images(Part(simulated=SimulatedDrive(street=1, seed=seed))).sha256 for seed in (1, 1, 2)
    )
    assert one == same != other


@pytest.mark.parametrize(
    ('said', 'problem'),
    [
        ({'strete': 3}, "unknown key 'strete'; did you mean street"),
        ({'noise': 'much'}, "noise: 'much' is not a number"),
        ({'num_frames': 2.5}, 'num_frames: 2.5 is not a number'),
        ({'street': -1}, 'seed: -1 is negative'),
    ],
)
def test_an_invalid_drive_is_refused(tmp_path, said, problem):
    with pytest.raises(ConfigError, match=problem) as caught:
        make_record(SimulatedDrive, said, 'set.yaml')
    assert '\n' not in str(caught.value) and 'set.yaml' in str(caught.value)


def test_backwards_the_last_image_comes_first_at_the_same_pace(street):
    encoding = EncodingConfig(image_size_px=128, saliency_threshold=0.2)
    forwards, _ = street.open().drives(encoding)
    text = street.file.read_text()
    street.write(text.replace('{path: query,', '{path: query, backwards: true,'))
    backwards, _ = street.open().drives(encoding)
    assert backwards.names == forwards.names[::-1]
    assert backwards.stamps_ns == forwards.stamps_ns
    for one, other in zip(backwards.descriptors, forwards.descriptors[::-1], strict=True):
        assert (one.cells == other.cells).all()


def test_each_drive_of_a_set_against_its_own_past_revisits_nothing(street, quick, tmp_path):
    for name in ('jinja2', 'matplotlib', 'pandas', 'sklearn'):
        pytest.importorskip(name)
    summaries = evaluate(
        [open_data_set(str(street.file))],
        quick,
        Plan(('convseq k=3',), protocols=('past',)),
        tmp_path / 'out',
    )
    assert [one['set'] for one in summaries] == [
        'street-query-forwards',
        'street-query-backwards',
        'street-reference-forwards',
        'street-reference-backwards',
    ]
    for one in summaries:
        assert (one['protocol'], one['known'], one['queries']) == ('online', 0, 24)
        assert one['accepted'] == one['false_closures']
        assert one['matched'] <= 1  # hardly a place is 20 scenes back


SMALL = """
name: small
query: {simulated: {street: 5, num_frames: 28, start_m: 1.5, lane_offset_m: -0.7, seed: 1,
                    width_px: 160, height_px: 120}}
reference: {simulated: {street: 5, num_frames: 28, width_px: 160, height_px: 120}}
truth: {kind: identity, tolerance: 3}
"""


def test_an_evaluation_gives_the_recognisers_answers_also_with_cached_descriptors(street):
    config = Config(keyframes=EVERY_FRAME)
    street.write(SMALL, 'small.yaml')
    material = street.open('small.yaml', config)
    recognizer = PlaceRecognizer(material.drives(config.encoding)[1].reference_map, config)
    expected = [recognizer.process(frame) for frame in material.query]
    assert sum(match.accepted is not None for match in expected) >= 3
    own = {'relative_pose': None, 'anchor': None}  # which are equal only to themselves
    found = [replace(one, **own) for one in recognize(material, config).matches]
    assert found == [replace(one, **own) for one in expected]
    again = recognize(material, config, (0, 28)).matches
    assert [match.candidates for match in again] == [match.candidates for match in expected]
