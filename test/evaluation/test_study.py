# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Studies, and the simulated changes that they are made of."""

import csv
import json

from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.changes import check_change, pace, PACES, picture_change, PICTURES
from convseq_ros.evaluation.drive import describe_drive
from convseq_ros.evaluation.recognition import pair_scores, recognize, with_known
from convseq_ros.evaluation.study import read_study, ready_made_studies, run_study
import numpy as np
import pytest

IMAGE = np.tile(np.arange(64, dtype=np.uint8) * 3, (48, 1))


def changed(kind, amount, index=0):
    return picture_change(kind, amount)(Frame(0, IMAGE), index).gray


def test_twice_the_speed_shows_every_second_frame():
    assert pace('speed', 2.0, 7).order == (0, 2, 4, 6)
    assert pace('speed', 0.5, 3).order == (0, 0, 1, 1, 2, 2)
    assert pace('speed', 1.0, 5).order == tuple(range(5))
    assert max(pace('speed', 0.67, 100).order) == 99


def test_lost_frames_leave_gaps_in_time():
    kept = pace('drop', 0.3, 100)
    assert 60 <= len(kept.order) <= 80
    assert list(kept.order) == sorted(set(kept.order))
    assert not kept.restamp
    assert pace('drop', 0.0, 9).order == tuple(range(9))


def test_a_stop_repeats_a_frame():
    assert pace('stops', 2, 8).order == (0, 1, 2, 2, 2, 3, 4, 4, 4, 5, 6, 6, 6, 7)


@pytest.mark.parametrize('kind', PICTURES)
def test_a_change_is_the_same_at_every_call_and_keeps_the_type(kind):
    amount = {'zoom': 1.2, 'rotate': 5, 'width': 32}.get(kind, 0.3)
    one, other = changed(kind, amount), changed(kind, amount)
    assert (one == other).all()
    assert one.dtype == np.uint8
    assert one.shape == ((24, 32) if kind == 'width' else IMAGE.shape)


@pytest.mark.parametrize(
    ('kind', 'amount'),
    [('darken', 0), ('fade', 0), ('shift', 0), ('zoom', 1), ('rotate', 0), ('width', 64)],
)
def test_no_change_is_no_change(kind, amount):
    assert (changed(kind, amount) == IMAGE).all()


def test_changes_do_what_they_say():
    assert changed('darken', 0.9)[40:].mean() < IMAGE.mean() / 2
    assert (changed('darken', 0.9, 1) != changed('darken', 0.9, 2)).any()
    assert changed('fade', 0.5).std() == pytest.approx(IMAGE.std() / 2, rel=0.05)
    assert (changed('shift', 0.25)[:, 16:] == IMAGE[:, :-16]).all()
    assert changed('zoom', 2.0).std() < IMAGE.std() * 0.6
    assert changed('rotate', 90)[:, 20].std() > 10


@pytest.mark.parametrize(('kind', 'amount'), [('fog', 1), ('darken', 2), ('zoom', 0.5)])
def test_a_change_that_makes_no_sense_is_refused(kind, amount):
    with pytest.raises(ConfigError, match=f'change .?{kind}'):
        check_change(kind, amount)


def study(street, text):
    return read_study(street.write(text, 'study.yaml'), street.folder)


def test_a_study_over_k_gives_one_row_for_each(street, quick, tmp_path):
    what = study(street, 'name: over_k\nsets: [street.yaml]\nvary: {fixed_length: [1, 2, 4]}')
    rows = run_study(what, quick, tmp_path / 'out', street.cache)
    assert [row['fixed_length'] for row in rows] == [1, 2, 4]
    assert [row['k_distribution'] for row in rows] == ['1:24', '2:23', '4:21']
    assert all(row['accuracy_matched'] >= 0.9 for row in rows)
    with (tmp_path / 'out' / 'over_k.csv').open(newline='') as file:
        assert [row['fixed_length'] for row in csv.DictReader(file)] == ['1', '2', '4']
    assert json.loads((tmp_path / 'out' / 'over_k.json').read_text())['rows'] == rows


def test_all_combinations_of_parameters_are_measured(street, quick, tmp_path):
    what = study(
        street,
        'sets: [street.yaml]\nmethods: [convseq, cohog]\n'
        'vary: {overlap_threshold: [0.0, 1.0], entropy_threshold: [0.0, 1.0]}',
    )
    rows = run_study(what, quick, tmp_path / 'out', street.cache)
    lengths = {
        (row['overlap_threshold'], row['entropy_threshold']): row['k_distribution']
        for row in rows
        if row['method'] == 'convseq'
    }
    assert len(rows) == 8
    assert lengths[1.0, 0.0] == '2:23'
    assert lengths[0.0, 1.0] == '4:21'
    assert lengths[0.0, 0.0] == '3:22'


def test_a_study_of_pace_keeps_track_of_what_is_right(street, quick, tmp_path):
    what = study(
        street,
        'sets: [street.yaml]\nmethods: [cohog]\n'
        'change: {speed: [1.0, 2.0], stops: [3], drop: [0.4], darken: [0.2]}',
    )
    rows = run_study(what, quick, tmp_path / 'out', street.cache)
    assert [(row['change'], row['amount']) for row in rows] == [
        ('speed', 1.0),
        ('speed', 2.0),
        ('stops', 3.0),
        ('drop', 0.4),
        ('darken', 0.2),
    ]
    assert [row['queries'] for row in rows[:3]] == [24, 12, 33]
    assert all(row['accuracy_all'] >= 0.9 for row in rows)


def test_another_pace_gives_what_the_images_themselves_would_give(street, quick):
    from dataclasses import replace

    material = street.open()
    new = pace('speed', 1.5, 24)
    images = replace(material.query, order=new.order, restamp=new.restamp)
    quickly = describe_drive(images, quick.encoding, street.cache)
    slowly = describe_drive(
        replace(images, change=lambda frame, _: frame), quick.encoding, Cache(None)
    )
    assert quickly.stamps_ns == slowly.stamps_ns
    assert quickly.names == slowly.names
    for one, other in zip(quickly.descriptors, slowly.descriptors, strict=True):
        assert (one.cells == other.cells).all()
    paced = replace(material, query=images, _drives={})
    whole = with_known(quick, {'search': 'exhaustive'})
    rows, _ = pair_scores(paced, whole)
    assert (rows == recognize(paced, whole).rows)[4:].all()


def test_the_studies_of_the_paper_are_ready_made(tmp_path):
    from pathlib import Path

    studies = {name: read_study(Path(name), tmp_path) for name in ready_made_studies()}
    assert {
        'k_ablation',
        'thresholds',
        'speed',
        'dropped_frames',
        'stops',
        'image_size',
        'appearance',
    } <= studies.keys()
    assert all(name == one.name for name, one in studies.items())
    changes = {kind for one in studies.values() for kind in one.change}
    assert changes == {*PACES, *PICTURES}


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('sets: []', 'says no sets'),
        ('sets: street.yaml', 'sets is not a list'),
        ('sets: [street.yaml]\nvary: {k: [1]}', "unknown parameter 'k'"),
        ('sets: [street.yaml]\nvary: {&k : [1]}', 'unknown parameter None'),
        ('sets: [street.yaml]\nvary: {5: [1]}', 'unknown parameter 5'),
        ('sets: [street.yaml]\nvary: {fixed_length: 3}', 'vary is not'),
        ('sets: [street.yaml]\nvary: {fixed_length: [-1]}', 'fixed_length: -1 is outside'),
        ('sets: [street.yaml]\nchange: {darken: [a lot]}', 'is not a number'),
        ('sets: [street.yaml]\nchange: {fog: [1]}', "change 'fog' is not one of"),
        ('sets: [street.yaml]\nchanges: {}', "unknown key 'changes'; did you mean change"),
    ],
)
def test_a_study_that_makes_no_sense_is_refused_in_one_line(street, text, problem):
    with pytest.raises(ConfigError, match=problem) as caught:
        study(street, text)
    assert '\n' not in str(caught.value)
