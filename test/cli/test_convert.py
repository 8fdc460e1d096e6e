# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq convert`: maps of format 3, of which `golden/format3.db` is one, stay in use."""

import json
from pathlib import Path
import shutil
import sqlite3

from convseq_ros.cli import main
from convseq_ros.config import KeyframeConfig
from convseq_ros.core.map.place import pack_cells
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.types import Pose
import numpy as np
import pytest

GOLDEN = Path(__file__).parents[1] / 'golden' / 'format3.db'


@pytest.fixture
def old(tmp_path):
    return Path(shutil.copy(GOLDEN, tmp_path / 'old.db'))


@pytest.fixture
def convert(old, tmp_path, capsys):
    """Return a way to run the command and get its exit code and what it said."""

    def run():
        code = main(['convert', str(old), str(tmp_path / 'new.db')])
        printed = capsys.readouterr()
        return code, printed.out + printed.err

    return run


def test_all_that_the_old_map_held_is_in_the_new_one(old, convert, tmp_path):
    before = old.read_bytes()
    code, said = convert()
    assert (code, said) == (0, f'{tmp_path / "new.db"}: 3 references, format 5\n')
    made = json.loads(MapReader(tmp_path / 'new.db').about()['encoding'])
    assert (made['image_size_px'], made['resize']) == (64, 'linear')
    opened, rng = open_map(tmp_path / 'new.db'), np.random.default_rng(0)
    assert opened.keyframes == KeyframeConfig(keyframe_interval_s=0.5)
    for index, place in enumerate(opened.places):
        pose = Pose((float(index), 0.1, 0.0), (0.0, 0.0, 0.0, 1.0)) if index % 2 else None
        assert (place.stamp_ns, place.pose) == (10**18 + index, pose)
        assert place.source == f'picture {index}.jpg'
        cells = pack_cells(rng.random((4, 4, 8), np.float32) * 391_754)
        assert (opened.packed(index) == cells).all()
        assert opened.thumbnail(index) == b'jpeg' * index
    assert [session.start_ns for session in opened.sessions] == [10**18]
    assert old.read_bytes() == before and len(list(tmp_path.iterdir())) == 2


def test_every_other_command_names_this_one(old, capsys, tmp_path):
    for arguments in (['info', old], ['replay', tmp_path, '--map', old, '--mode', 'online']):
        assert main([str(one) for one in arguments]) == 1
        assert f'{old}: map format 3, this program reads 5; run: convseq convert' in (
            capsys.readouterr().err
        )


def test_a_file_that_is_there_is_not_replaced(old, convert, tmp_path):
    (tmp_path / 'new.db').write_text('of somebody')
    assert convert() == (
        1, f'convseq convert: {tmp_path / "new.db"}: exists already; name another file\n'
    )  # fmt: skip
    assert (tmp_path / 'new.db').read_text() == 'of somebody'


@pytest.mark.parametrize(
    'change',
    [
        'DELETE FROM places WHERE reference_index = 2',
        'UPDATE pictures SET cells = zeroblob(240) WHERE reference_index = 1',
        'UPDATE places SET stamp_ns = 1 WHERE reference_index = 0',
        "DELETE FROM about WHERE name = 'encoding'",
        'CREATE TRIGGER hostile AFTER INSERT ON places BEGIN DELETE FROM places; END',
    ],
)
def test_a_damaged_map_is_one_line_and_makes_no_file(old, convert, change, tmp_path):
    with sqlite3.connect(old) as database:
        database.execute(change)
    database.close()
    code, said = convert()
    assert code == 1 and said.count('\n') == 1 and f'{old}: damaged map (' in said
    assert list(tmp_path.iterdir()) == [old]


def test_a_map_of_this_format_is_told_so(convert, old, tmp_path):
    convert()
    (tmp_path / 'new.db').rename(old)
    assert convert() == (1, f'convseq convert: {old}: is of format 5 already\n')
