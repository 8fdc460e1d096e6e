# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq map browse`: a page of the links of a map, and how to take out the wrong one."""

from base64 import b64decode
import shlex
import sys

from convseq_ros.cli import main
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.core.types import Frame, RelativePose
import numpy as np
from pictures import scene
import pytest
from web_page import data_of

COUNT = 12  # places of each of two rounds
WRONG = COUNT + 5
NOISE = np.diag([0.01] * 3 + [1e-4] * 3)


@pytest.fixture
def path(tmp_path):
    """Return a map of two rounds, one metre aside, places linked, one of them wrongly."""
    rounds = ReferenceMap()
    for at in range(2 * COUNT):
        number, place = divmod(at, COUNT)
        gray = scene(place, number)
        pose = of_roll_pitch_yaw((float(place), float(number), 0.0), 0.0, 0.0, 0.0)
        frame = Frame(at, gray, f'{at:03}.png', pose)
        rounds.add_frame(frame, describe(gray, rounds.encoding), 128, 0, 300)
    for place in range(COUNT):
        other = place + 4 if place + COUNT == WRONG else place
        pose = RelativePose((0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0), None, NOISE, 9)
        rounds.links.add(COUNT + place, other, 0.95, 100 + place, pose)
    save_map(rounds, tmp_path / 'a map.db')
    return tmp_path / 'a map.db'


def browsed(path, capsys):
    """Return the data of the page, its text, and what the command prints."""
    page = path.with_name('links.html')
    assert main(['map', 'browse', str(path), '-o', str(page)]) == 0
    return data_of(page), page.read_text('utf-8'), capsys.readouterr()


def test_a_link_that_the_poses_deny_is_reported_with_the_command_that_removes_it(path, capsys):
    pytest.importorskip('gtsam')
    before = path.read_bytes()
    data, text, printed = browsed(path, capsys)
    summary, remedy = printed.out.splitlines()
    assert summary.endswith(f'links.html: {COUNT} links, 1 denied by the poses')
    assert path.read_bytes() == before
    rows = data['runs'][0]['rows']
    assert [row[0] for row in rows].count('linked') == COUNT - 1
    (denied,) = (row for row in rows if row[0] == 'denied by the poses')
    assert denied[1].startswith(f'Place {WRONG} is linked to place {WRONG - COUNT + 4}\n')
    line = remedy.partition('convseq ')[2]
    assert denied[1].endswith(line) and line.endswith(f' --place {WRONG}')
    assert text.count('class="arc"') == COUNT
    assert main(shlex.split(line)) == 0
    assert [link.place for link in open_map(path).links.each()] == [
        COUNT + place for place in range(COUNT) if COUNT + place != WRONG
    ]


def test_each_link_has_its_pair_the_least_agreeing_first(path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'gtsam', None)
    data, _, printed = browsed(path, capsys)
    assert 'which links the poses deny is not known: gtsam is not installed' in printed.err
    assert printed.out.splitlines()[1].endswith(f"convseq map unlink '{path}' --place N")
    rows, whole = data['runs'][0]['rows'], open_map(path)
    assert [row[-1] for row in rows] == [*range(COUNT)]  # they agree more and more
    for at, row in enumerate(rows):
        pictures = [b64decode(data['pictures'][number].partition(',')[2]) for number in row[4:6]]
        other = whole.links.details(COUNT + at).other
        assert pictures == [whole.thumbnail(COUNT + at), whole.thumbnail(other)]
        assert row[2] == f'Place {COUNT + at} of session 0\n{COUNT + at:03}.png'
        assert f'{100 + at} regions agree' in row[3] and '1.00 m left' in row[3]
        if other == at:
            for marks in row[6:8]:
                ends = np.frombuffer(b64decode(marks), np.uint8).reshape(-1, 2, 2).astype(int)
                assert len(ends) > 4 and abs(ends[:, 0] - ends[:, 1]).mean() < 4


def test_browsing_a_map_without_links_is_refused_in_one_line(path, capsys):
    assert main(['map', 'unlink', str(path)]) == 0
    assert main(['map', 'browse', str(path), '-o', str(path.with_name('none.html'))]) == 1
    assert 'a map.db: has no link; `convseq map link` looks for some\n' in capsys.readouterr().err
    assert not path.with_name('none.html').exists()
