# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A short part of what `make torture` does to maps."""

from pathlib import Path
import sys

from programs import run
import pytest

from bench.torture.attack import attacks
from bench.torture.disk import compiler
from bench.torture.scenarios import SCENARIOS

REPOSITORY = Path(__file__).resolve().parents[2]


NEED_A_COMPILER = 'map_power', 'map_writes'


@pytest.mark.parametrize('name', ['hostile_maps', 'map_damage', 'log_damage', *NEED_A_COMPILER])
def test_maps_survive_a_short_part_of_the_torture(name):
    if name in NEED_A_COMPILER and not compiler():
        pytest.skip('needs a C compiler')
    command = [sys.executable, '-m', 'bench.torture', name, '--short']
    done = run(*command, cwd=REPOSITORY)
    count = attacks()[name].SHORT
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f'{name}: {count} of {count} in '), done.stdout + done.stderr


LIES = """
import sys
from pathlib import Path
from bench.torture import scenarios
from convseq_ros.core.map.autosave import Autosave
# A program that says at once that all is safe.
Autosave.flush = lambda self: setattr(self, 'committed', len(self.reference_map))
scenarios.SCENARIOS = {'grow': scenarios.SCENARIOS['grow']}
sys.argv[1:] = ['6', '0', sys.argv[1]]
scenarios.main()
"""


def test_the_torture_finds_out_who_lies(tmp_path):
    assert 'grow' in SCENARIOS
    if not compiler():
        pytest.skip('needs a C compiler')
    from bench.torture.disk import environment

    done = run(
        sys.executable, '-c', LIES, str(tmp_path), cwd=REPOSITORY, env=environment(tmp_path)
    )
    told = done.stdout.splitlines()
    assert len(told) == 6 and sum('AssertionError' in line for line in told) > 2, done
