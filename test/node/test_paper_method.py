# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node with config/paper.yaml gives the answers of the paper's released script, over DDS."""

import csv
from pathlib import Path

from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.writer import save_map
from convseq_ros.io.results import read_results
import cv2
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import Int32
from world import map_of

PAPERS = Path(__file__).resolve().parents[2] / 'config' / 'paper.yaml'
STEP_NS, COUNT = 10**9, 40  # between queries, and the queries, of 111


def backwards(folder):
    """Return the images of a drive from its end, as the script reads ahead and we look back."""
    paths = sorted(folder.glob('*.jpg'), reverse=True)
    return [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]


@pytest.mark.once
def test_the_node_gives_the_answers_of_the_released_script(
    shared_data, client, vpr, image, tmp_path
):
    corridor, config = shared_data / 'corridor', make_config(read_parameter_file(PAPERS))
    shown = (describe(gray, config.encoding) for gray in backwards(corridor / 'ref'))
    reference_map = map_of(shown, config.encoding, config.keyframes)
    save_map(reference_map, tmp_path / 'corridor.db')
    files = {'map_path': tmp_path / 'corridor.db', 'result_file': tmp_path / 'result.csv'}
    vpr('--params-file', str(PAPERS), **files)
    heard, camera = client.listen(Int32, '/vpr_node/match_index'), client.camera(Image)
    queries = backwards(corridor / 'query')[:COUNT]
    for index, gray in enumerate(queries, 1):
        camera.publish(image(gray, index * STEP_NS))
        client.wait_for(lambda count=index: len(heard) == count, 'an answer')
    last, rows = len(reference_map) - 1, read_results(tmp_path / 'result.csv')
    assert len(rows) == COUNT
    found = {
        last - int(row['query_index']): (
            last - int(row['reference_index']),
            pytest.approx(float(row['score']), abs=2e-5),
            int(row['sequence_length']),
        )
        for row in rows
        if row['reference_index']
    }
    with (corridor / 'golden' / 'authors_dynamic_corridor.csv').open() as file:
        rows = [[float(value) for value in row] for row in csv.reader(file)]
    golden = [row for row in rows if row[0] > last - COUNT]
    assert len(golden) == 26
    assert {int(row[0]): (int(row[1]), row[2], int(row[3])) for row in golden} == found
