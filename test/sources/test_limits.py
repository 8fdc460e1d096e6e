# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every limit of what is read is a parameter; the line when it bites tells what to set."""

import argparse
from importlib import import_module
import re
from types import SimpleNamespace

from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import Config, EncodingConfig
from convseq_ros.config.parameter import parameters
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.given_files import read_descriptors, read_scores
from convseq_ros.evaluation.run_folder import read_summaries
from convseq_ros.evaluation.truth import read_pairs, read_positions
from convseq_ros.io.mask_file import read_mask
from convseq_ros.sources import open_source
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.images import image_pixels
from convseq_ros.sources.pose_file import read_pose_file
import cv2
import numpy as np
import pytest

LINE = re.compile(r' is more than (\w+), [\d.]+; make it smaller, or set \1 to ([\d.]+)')
LEAST = {item.name: item.low for item in parameters(ReadingConfig)}
PADDING = '# ' * 40 + '\n'
CALIBRATION = 'P0: 700 0 320 0 0 700 240 0 0 0 1 0\n'
DATA_SET = 'name: a\nquery: {path: a}\nreference: {path: b}\ntruth: {kind: identity}\n'
IMAGE = np.full((512, 512), 255, np.uint8)
IMAGE[::2, 0] = 254
MESSAGE = {'height': 512, 'width': 512, 'encoding': 'mono8', 'is_bigendian': 0, 'step': 512}
MESSAGE['data'] = IMAGE


def text_of(content):
    return lambda path: path.write_text(content)


def array(path):
    with path.open('wb') as file:
        np.save(file, np.ones((60, 60)))


def picture(path):
    path.write_bytes(cv2.imencode('.png', IMAGE)[1].tobytes())


def naming(mask, reading):
    """Return a configuration with the path of a mask."""
    return Config(encoding=EncodingConfig(image_mask=str(mask)), reading=reading)


PADDING_JSON = '{"set": "a", "method": "b", "protocol_version": 3}' + ' ' * 300
WHOLE_FILES = {
    'parameters': (text_of(PADDING + '/**:\n  ros__parameters: {}\n'), read_parameter_file),
    'data set': (text_of(PADDING + DATA_SET), lambda p, r: open_data_set(f'{p}', reading=r)),
    'calibration': (text_of(PADDING + CALIBRATION), lambda p, r: read_camera_file(p, 480, 640, r)),
    'poses': (text_of('1 0 0 0 0 0 0 1\n' * 20), lambda p, r: read_pose_file(p, 20, r)),
    'pairs': (
        text_of('query,reference\n' + '0,0\n' * 60),
        lambda p, r: read_pairs(p, ['a'], ['b'], reading=r),
    ),
    'positions': (
        text_of('x,y\n' + '0,0\n' * 60),
        lambda p, r: read_positions(p, 'query', ['a.png'] * 60, r),
    ),
    'scores': (array, lambda p, r: read_scores(p, 60, 60, reading=r)),
    'descriptors': (array, lambda p, r: read_descriptors(p, 60, r)),
    'summary': (text_of(PADDING_JSON), lambda p, r: read_summaries([p], r)),
    'mask': (picture, lambda p, r: read_mask(naming(p, r))),
}


def refused_then_read(name, read):
    """Read with the least limit, which is refused, and with the one that the refusal tells."""
    with pytest.raises(ConvseqError) as caught:
        read(ReadingConfig(**{name: LEAST[name]}))
    found = LINE.search(str(caught.value))
    assert found and found[1] == name, caught.value
    read(ReadingConfig(**{name: float(found[2])}))


@pytest.mark.parametrize('kind', WHOLE_FILES)
def test_the_size_limit_in_the_error_lets_the_file_be_read(tmp_path, kind):
    write, read = WHOLE_FILES[kind]
    path = tmp_path / ('file.yaml' if kind == 'data set' else 'file')
    write(path)
    refused_then_read('max_file_mb', lambda reading: read(path, reading))
    read(path, ReadingConfig())


def first_picture(folder, reading):
    frame = next(iter(open_source(folder, reading=reading)))
    if frame.problem:
        raise ConvseqError(frame.problem)


@pytest.mark.parametrize(
    'read',
    [
        first_picture,
        lambda path, reading: read_mask(naming(path / '1.png', reading)),
        lambda _, reading: image_pixels(SimpleNamespace(**MESSAGE), reading),
    ],
)
def test_the_pixel_limit_in_the_error_lets_the_image_be_read(tmp_path, read):
    picture(tmp_path / '1.png')
    refused_then_read('max_image_mpx', lambda reading: read(tmp_path, reading))


def test_the_error_suggests_no_limit_above_the_parameters_maximum():
    line = ReadingConfig().above('max_image_mpx', 4225.0, 'x')
    assert line.endswith('make it smaller, or max_image_mpx goes to 1000')


@pytest.mark.parametrize(
    'command', ['build-map', 'replay', 'evaluate', 'info', 'report', 'locate']
)
def test_a_command_that_reads_files_takes_every_limit(command):
    parser = argparse.ArgumentParser(allow_abbrev=False)
    import_module(f'convseq_ros.cli.{command.replace("-", "_")}').describe(parser)
    for name in LEAST:
        assert f'--{name.replace("_", "-")}' in parser.format_help()
