# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The street is the same whenever it is drawn, and nowhere the same twice."""

from dataclasses import replace

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.light import LIGHTS
from convseq_ros.simulation.street import Street
from convseq_ros.simulation.view import View
import numpy as np
import pytest


def view(street, light='day'):
    return View(street, LIGHTS[light], 160, 120, 80.0)


@pytest.mark.parametrize('light', ['day', 'night'])
def test_same_seed_gives_same_pixels(light):
    first, again = (view(Street(500.0, 3), light).draw(120.0, -1.5, np.pi / 2) for _ in range(2))
    assert first.shape == (120, 160, 3)
    assert np.array_equal(first, again)


@pytest.mark.parametrize('light', ['day', 'night'])
def test_a_twin_has_the_same_houses_and_things_of_its_own(light):
    street = Street(500.0, 3)
    one, other, own = (
        replace(street, things_seed=things, alike=alike).stretch(2, LIGHTS[light])
        for things, alike in ((None, 1.0), (7, 1.0), (7, 0.5))
    )

    def told(panels, *names):
        return [[getattr(panel, name) for name in names] for panel in panels]

    shape, paint = ('start', 'end', 'top', 'lamps'), ('seed',)
    assert told(one.buildings, *shape, *paint) == told(other.buildings, *shape, *paint)
    assert told(one.things, 'start') != told(other.things, 'start')
    assert one.things[0].lamps == other.things[-1].lamps
    assert told(one.buildings, *shape) == told(own.buildings, *shape)
    same = [a == b for a, b in zip(*(told(s.buildings, *paint) for s in (one, own)), strict=True)]
    assert 0.3 < sum(same) / len(same) < 0.7


@pytest.mark.parametrize(('length', 'seed'), [(0.0, 1), (-5.0, 1), (float('nan'), 1), (10.0, -1)])
def test_an_impossible_street_is_refused(length, seed):
    with pytest.raises(ConvseqError):
        Street(length, seed)


@pytest.mark.parametrize('twin', [{'things_seed': -1}, {'alike': 1.5}, {'alike': float('nan')}])
def test_an_impossible_twin_is_refused(twin):
    with pytest.raises(ConvseqError):
        Street(10.0, 1, **twin)
