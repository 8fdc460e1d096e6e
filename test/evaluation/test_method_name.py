# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How methods are written on a command line."""

from convseq_ros.config import Config
from convseq_ros.evaluation.method_name import parse_method
from convseq_ros.evaluation.methods import KINDS, make_method
import pytest


@pytest.mark.parametrize(
    ('text', 'label', 'kind', 'argument', 'length'),
    [
        ('convseq', 'convseq', 'convseq', '', None),
        ('convseq-k10', 'convseq-k10', 'convseq', '', 10),
        ('convseq-forward', 'convseq-forward', 'convseq-forward', '', None),
        ('convseq-forward-k5', 'convseq-forward-k5', 'convseq-forward', '', 5),
        ('scores:a/net.npy@dynamic', 'net-dynamic', 'scores', 'a/net.npy', 0),
        ('net=scores:a-k3.npy@k7', 'net', 'scores', 'a-k3.npy', 7),
        ('descriptors:q.npy,r.npy@single', 'q-single', 'descriptors', 'q.npy,r.npy', 1),
    ],
)
def test_a_text_names_label_kind_files_and_length(text, label, kind, argument, length):
    name = parse_method(text)
    assert (name.label, name.kind, name.argument, name.length) == (label, kind, argument, length)


def test_options_follow_a_plus(tmp_path):
    name = parse_method('net=onnx:m.onnx@k10+size=224x224+mean=0.5,0.5,0.5')
    assert name.options == {'size': '224x224', 'mean': '0.5,0.5,0.5'}
    assert (name.argument, name.length) == ('m.onnx', 10)


def test_parameters_of_the_core_are_options_of_every_method():
    method = make_method(parse_method('own=convseq+rival_distance=20+matching=regional'), Config())
    assert method.config.acceptance.rival_distance == 20
    assert method.name.label == 'own'


def test_the_length_of_a_method_wins_over_the_parameter():
    from convseq_ros.evaluation.recognition import with_known

    config = with_known(Config(), {'fixed_length': 7})
    lengths = {
        kind: make_method(parse_method(kind), config).config.sequence.fixed_length
        for kind, row in KINDS.items()
        if not row.argument
    }
    assert lengths == {
        'convseq': 7, 'convseq-forward': 7, 'cohog': 1, 'seqslam': 10, 'hog': 1, 'orb-bow': 1,
        'sift-vlad': 1,
    }  # fmt: skip


def test_the_published_methods_match_as_published():
    from convseq_ros.evaluation.recognition import with_known

    config = with_known(Config(), {'matching': 'coherent', 'search': 'shortlist'})
    for kind in ('cohog', 'convseq-forward'):
        method = make_method(parse_method(kind), config)
        assert method.config.matching.matching == 'regional'
        assert method.config.matching.search == 'exhaustive'


@pytest.mark.parametrize('text', ['convseq-k1', 'convseq@single', 'convseq@k1', 'convseq-k10'])
def test_so_many_frames_are_decided_by_their_margin(text):
    config = make_method(parse_method(text), Config()).config
    assert config.sequence.fixed_length == (10 if '10' in text else 1) and not config.believes
    asked = make_method(parse_method(f'{text}+acceptance_rule=belief'), Config()).config
    assert asked.believes


@pytest.mark.parametrize('text', ['convseq', 'convseq@dynamic', 'convseq+rival_distance=20'])
def test_any_other_recogniser_decides_as_it_does_without_the_bench(text):
    assert make_method(parse_method(text), Config()).config.believes
