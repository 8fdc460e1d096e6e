# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fleets, `convseq map` and `locate` keep the vectors of a descriptor model, and ask for it."""

import json
import shutil

from convseq_ros.cli import main
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.io.results import read_results
from descriptor_models import made
import numpy as np
import pytest

SURE = '--matching', 'regional', '--search', 'exhaustive', '--fixed-length', '1'


@pytest.fixture(scope='module')
def net(tmp_path_factory):
    """Return a model of 64 numbers."""
    return made(tmp_path_factory.mktemp('net') / 'net.onnx', numbers=64)


@pytest.fixture(scope='module')
def maps(net, recordings, scheduler, tmp_path_factory):
    """Return a folder of a map of each recording, which a fleet built with the model."""
    folder = tmp_path_factory.mktemp('maps')
    build = ['fleet', 'build', recordings, '-o', folder, '--scheduler', scheduler]
    assert run(*build, '--descriptor-model', net, '--keyframe-overlap', 1) == 0
    return folder


@pytest.fixture(scope='module')
def merged(maps, tmp_path_factory):
    """Return one map of all of them."""
    path = tmp_path_factory.mktemp('merged') / 'merged.db'
    assert run('map', 'merge', *sorted(maps.glob('*.db')), '-o', path, '--no-links') == 0
    return path


def run(*arguments):
    return main([str(one) for one in arguments])


def vectors(path):
    """Return the vectors of a map, which says that they are a model's."""
    assert MapReader(path).encoding.descriptor_model.startswith('#')
    return open_map(path).global_descriptors


def test_a_fleet_answers_as_the_merged_map_does_and_every_verb_keeps_vectors(
    maps, merged, net, recordings, scheduler, tmp_path
):
    model = '--descriptor-model', net
    every = np.concatenate([vectors(path) for path in sorted(maps.glob('*.db'))])
    assert every.shape == (60, 64) and np.array_equal(vectors(merged), every)

    query, said = recordings / 'drive_1', []
    for name, asked in (
        ('fleet.csv', ('fleet', 'replay', maps, query, '--scheduler', scheduler)),
        ('merged.csv', ('replay', query, '--map', merged)),
    ):
        assert run(*asked, '--output', tmp_path / name, *model) == 0
        said.append(read_results(tmp_path / name))
        for row in said[-1]:
            del row['duration_ms']
    assert said[0] == said[1] and len(said[0]) == 20

    parts = tmp_path / 'parts'
    assert run('map', 'split', merged, '-o', parts) == 0
    split = [vectors(path) for path in sorted(parts.glob('*.db'))]
    assert np.array_equal(np.concatenate(split), every)
    shutil.copy(merged, tmp_path)
    assert run('map', 'rename', tmp_path / merged.name, '--session', 0, 'first') == 0
    assert run('map', 'remove', tmp_path / merged.name, '--session', 'first') == 0
    assert np.array_equal(vectors(tmp_path / merged.name), every[20:])


def test_locate_uses_the_model_of_the_map_and_refuses_another(
    merged, net, recordings, tmp_path, capsys
):
    asked = sorted((recordings / 'drive_1').glob('*.png'))[3:6]
    locate = ['locate', *asked, '--map', merged, '--json', *SURE]
    for model in ([], ['--descriptor-model', net]):
        assert run(*locate, *model) == 0
        said = json.loads(capsys.readouterr().out)
        assert said['place'] == 20 + 5, said
    assert run(*locate, '--descriptor-model', made(tmp_path / 'other.onnx', numbers=32)) == 1
    assert 'descriptor_model' in capsys.readouterr().err
