# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench and a short part of the torture run to their end, and see what is wrong."""

import json
import os
from pathlib import Path
import re
import resource
import sys
import time

from convseq_ros.core.compiled import library
from programs import run
import pytest

from bench.finding import is_met
from bench.page import beside, is_main, of_a_city, ROBOTS
from bench.part import PARTS
from bench.parts.frames import STAGES
from bench.torture import forked, fuzz
from bench.torture.disk import compiler, environment

REPOSITORY = Path(__file__).resolve().parents[2]
NEED_A_COMPILER = {'map_power': 24, 'map_writes': 8}  # tries
CHEAP = {'hostile_maps': 10, 'log_damage': 20, 'map_damage': 25, 'fuzz': 10, 'graph_numbers': 5}


def need_packages():
    for name in ('mcap', 'rosbags'):
        pytest.importorskip(name, reason=f'the attacks need {name}: pip install {name}')


@pytest.mark.parametrize(('name', 'count'), (CHEAP | NEED_A_COMPILER).items())
def test_files_and_decoders_survive_a_short_part_of_the_torture(name, count):
    if name in NEED_A_COMPILER and not compiler():
        pytest.skip('needs a C compiler')
    if name == 'fuzz' and fuzz.MISSING:
        pytest.skip(fuzz.MISSING)
    if name == 'graph_numbers':
        pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')
    need_packages()
    done = run(sys.executable, '-m', 'bench.torture', name, '--count', count, cwd=REPOSITORY)
    assert done.returncode == 0, done.stdout + done.stderr
    assert name == 'fuzz' or done.stdout.startswith(f'{name}: {count} of {count}, '), done


LIES = """
import sys
from bench.torture import attack, disk_attacks
from convseq_ros.core.map.appender import Appender
# A program that says at once that all is safe.
Appender.flush = lambda self: setattr(self, 'committed', len(self.reference_map))
disk_attacks.SCENARIOS = {'make': disk_attacks.SCENARIOS['make']}
attack.print_tries(sys.argv[1], '6', '0', sys.argv[2])
"""


@pytest.mark.parametrize('name', NEED_A_COMPILER)
def test_the_torture_detects_stores_that_lie(name, tmp_path):
    if not compiler():
        pytest.skip('needs a C compiler')
    own = environment(tmp_path)
    done = run(sys.executable, '-c', LIES, name, tmp_path, cwd=REPOSITORY, env=own)
    told = done.stdout.splitlines()
    assert len(told) == 6 and sum('AssertionError' in line for line in told) > 2, done


SPARE_BYTES = 200_000_000


def fails():
    raise ZeroDivisionError('on purpose')


def takes_memory():
    return len(b'x' * 2 * SPARE_BYTES) * 0


def burns():
    while True:
        pass


def test_the_oracle_reports_every_kind_of_failure(monkeypatch):
    # What is forked off begins with the memory that this process has by now.
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    own_bytes = pages * resource.getpagesize()
    monkeypatch.setattr(forked, 'MOST_BYTES', own_bytes + SPARE_BYTES)
    assert forked.ended(lambda: 0).problem == ''
    assert 'on purpose' in forked.ended(fails).problem
    assert 'exit 1, 0 lines' in forked.ended(lambda: 1).problem
    assert 'exit 3' in forked.ended(lambda: 3).problem
    assert 'GB' in forked.ended(takes_memory).problem
    assert 'took more than' in forked.ended(burns, most_s=1).problem
    monkeypatch.setattr(forked, 'BLOCKED_S', 1)
    assert 'took more than' in forked.ended(lambda: time.sleep(60)).problem


def test_the_fuzzer_reports_what_breaks_a_decoder_and_keeps_the_input(tmp_path):
    if fuzz.MISSING:
        pytest.skip(fuzz.MISSING)
    own, script = os.environ | {'PYTHONPATH': str(REPOSITORY)}, 'breaking_decoders.py'
    done = run(sys.executable, Path(__file__).with_name(script), tmp_path, env=own)
    assert done.returncode == 0, done.stderr
    *broken, holds = map(json.loads, done.stdout.splitlines())
    assert holds == ['holds', '', 100]
    assert [name for name, *_ in broken] == ['fails', 'dies', 'burns']
    for _, problem, _ in broken:
        kept = Path(problem.split('; ')[-1])
        assert kept.read_bytes().startswith(b'!'), problem


def test_every_decoder_takes_the_samples_that_it_is_fuzzed_with(tmp_path):
    need_packages()
    from bench.torture.decoders import decoders

    for name, (samples, decode) in decoders().items():
        for number, sample in enumerate(samples):
            folder = tmp_path / f'{name} {number}'
            folder.mkdir()
            decode(sample, folder)


def test_every_part_measures_and_the_page_is_written(tmp_path):
    command = [sys.executable, '-m', 'bench', '--quick', '--best-kernels', '--page', '--docs']
    done = run(*command, tmp_path, '--json', tmp_path / 'performance.json', cwd=REPOSITORY)
    assert done.returncode == 0, done.stderr
    measured = json.loads((tmp_path / 'performance.json').read_text(encoding='utf-8'))
    by_part = {name: [] for name in PARTS}
    for row in measured['findings']:
        by_part[row['part']].append(row)
        assert row['value'] is not None or row['note'], row
    assert all(by_part.values())
    assert 0.1 < measured['about']['machine']['clock_ghz'] < 10

    (note,) = (row['note'] for row in by_part['kernels'] if 'error ' in row['note'])
    assert float(note.split()[1]) <= 1e-2

    whole = [row for row in by_part['frames'] if row['side'] == 'whole']
    assert whole and all(row['note'].endswith('3 of 3 right') for row in whole), whole
    frame = {row['side']: row['value'] for row in by_part['frames']}
    assert {*STAGES} <= {*frame} and frame['operations'] > 0 and frame['pairs in full'] > 0
    split = frame['scales with the integer peak'] + frame['scales with the clock']
    assert split == pytest.approx(frame['whole'])

    page = (tmp_path / 'PERFORMANCE.md').read_text(encoding='utf-8')
    aimed = [row for row in measured['findings'] if is_met(row) is not None]
    wanted = [
        f'\\| {re.escape(row["what"])} \\|.* {re.escape(row["side"])}: '
        for row in aimed
        if is_main(row) and row['part'] != 'frames'
    ]
    assert wanted and all(re.search(row, page) for row in wanted)
    assert 'missed' not in page and 'at most' not in page  # targets are for developers
    assert all(f'| {name} |' in page for name in ROBOTS) or not library().variant
    assert 'Not measured' not in page
    assert re.search(r'\| covisibility \| [0-9.e-]+ \|', page)  # of one size


def test_frames_of_earlier_commits_are_told_by_size():
    row = {'part': 'frames', 'side': 'whole', 'kernels': '', 'threads': 1, 'value': 9.0}
    rows = [{**row, 'what': 'frame, R = 48'}, {**row, 'what': 'frame, R = 96', 'value': 10.0}]
    rows.append({**rows[0], 'kernels': 'numpy', 'value': 50.0})
    earlier = {'commit': 'bd64ee3d', 'frames': {'frame, R = 48': 12.0}}
    assert beside(rows, [earlier]) == 'The same frames took 12, - ms at bd64ee3d.\n'


def test_a_city_lies_on_the_line_through_the_two_largest_maps():
    def row(what, side, value, unit):
        return {'what': what, 'side': side, 'value': value, 'unit': unit, 'kernels': None}

    rows = [
        row(f'{what}, R = {size}', side, value, unit)
        for size, times in (('1,000', 9.0), ('10,000', 1.0), ('100,000', 2.0))
        for what, side, value, unit in (
            ('frame', 'whole', 10 * times, 'ms'),
            ('map', 'resident', 100 * times, 'MB'),
            ('map', 'open', times, 's'),
        )
    ]
    told = of_a_city(rows).replace('\n', ' ')
    assert 'a frame 120 ms, resident 1,200 MB, to open 12 s.' in told
    assert of_a_city(rows[:3]) == ''  # a single map has no line
