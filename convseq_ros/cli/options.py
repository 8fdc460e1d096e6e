# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by commands: options, parameter files, and output for a person at a terminal."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
import shlex
import sys
from typing import Any, TypeVar

from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import Config, core_parameters, make_config, OnlineConfig, RobotConfig
from convseq_ros.config.arguments import local, sentence
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import add_parameters, given, parameters, Value
from convseq_ros.config.reading_config import chosen_reading
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.map.reader import open_map
from convseq_ros.errors import ConfigError, MapError, printable
from convseq_ros.io.mask_file import read_mask
from convseq_ros.sources.mount import Tf

Item = TypeVar('Item')
_MOST_CHARACTERS = 200  # of a session's name


def add_verb(
    verbs: Any, name: str, act: Callable[[argparse.Namespace], Any], text: str
) -> argparse.ArgumentParser:
    """Add a verb that runs `act` to a command; return its parser for further arguments."""
    verb: argparse.ArgumentParser = verbs.add_parser(name, help=text, description=sentence(text))
    verb.set_defaults(act=act)
    return verb


def add_max_looks(parser: Any, keeps_all: bool = True) -> None:
    """Add the option `--max-looks`; its default keeps all stretches, or as many as online mode."""
    (item,) = (item for item in parameters(OnlineConfig) if item.name == 'max_looks')
    default = 0 if keeps_all else item.default
    help_ = 'maximum number of stretches, of 16 keyframes, that a place keeps; similar ones go '
    help_ += f'first; 0 keeps all; default: {default}'
    parser.add_argument('--max-looks', type=item.parse, default=default, metavar='N', help=help_)


def add_images(parser: argparse.ArgumentParser, poses: bool = True) -> None:
    """Declare which images are read, and where their poses and cameras come from."""
    add = parser.add_argument
    several = 'of several cameras, in quotes with spaces between'
    add('--topic', default='', help=f'image topic, if there are several; {several}')
    help_ = 'rate of a folder of pictures; default: by the times in their names, else 10'
    add('--rate', type=float, metavar='HZ', help=help_)
    add('--odom', default='', metavar='TOPIC', help='topic of poses')
    if poses:
        help_ = 'text file of poses instead, as TUM or KITTI; or a folder with one for each image'
        add('--poses', type=Path, metavar='FILE', help=help_)
        help_ = "axes of poses of TUM: a robot's, x ahead, z up, or a lens's, z ahead, y down; "
        help_ += 'default: robot, and a file whose poses move along their z is refused'
        add('--pose-axes', choices=('robot', 'lens'), default='', help=help_)
    help_ = f'topic or file (YAML of ROS, calib.txt of KITTI, matrix) of the camera; {several}'
    add('--camera-info', type=local, default='', metavar='TOPIC|FILE', help=help_)
    base = NodeConfig().base_frame
    help_ = f'frame of the robot in /tf_static, which says where the camera is; default: {base}'
    add('--base-frame', default=base, metavar='NAME', help=help_)


def chosen_images(chosen: argparse.Namespace) -> dict[str, Any]:
    """Return what `add_images` declares, as `open_each_camera` takes it."""
    names = 'odom', 'camera_info', 'poses', 'pose_axes'
    tf = Tf(chosen.base_frame, _given_mount(chosen), note)
    texts = {name: getattr(chosen, name, None) or '' for name in names}
    return {'topics': chosen.topic, 'tf': tf, 'rate_hz': chosen.rate, **texts}


def _given_mount(chosen: argparse.Namespace) -> str:
    """Return the value of camera_to_base that was given, on the command line or in a file."""
    text: str | None = getattr(chosen, 'camera_to_base', None)
    if text is None and (path := getattr(chosen, 'config', None)):
        text = read_parameter_file(path, chosen_reading(chosen)).get('camera_to_base')
        return '' if text == RobotConfig().camera_to_base else text or ''
    return text or ''


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add `--config FILE` and an option for every parameter that decides a match."""
    help_ = 'parameter file, the same YAML that the node reads; options win over it'
    parser.add_argument('--config', type=Path, metavar='FILE', help=help_)
    add_parameters(parser, 'parameters', core_parameters())


def chosen_config(
    chosen: argparse.Namespace, otherwise: Mapping[str, Value] | None = None
) -> Config:
    """Return the values of options, else of the file, else `otherwise`; ConfigError if invalid."""
    reading = chosen_reading(chosen)
    values = read_parameter_file(chosen.config, reading) if chosen.config else {}
    config = make_config({**(otherwise or {}), **values, **given(chosen, core_parameters())})
    return masked(config, read_mask(config))


def refuse_name(name: str) -> None:
    """Raise a ConfigError for a new name of a session that is no short line."""
    if not name.isprintable() or not 0 < len(name) <= _MOST_CHARACTERS:
        raise ConfigError(f'name: {name!a} is not a line of 1 to {_MOST_CHARACTERS} characters')


def progress(items: Iterable[Item], total: int, name: str, unit: str = 'frames') -> Iterator[Item]:
    """Yield the items; show progress, speed and remaining time in a terminal."""
    if sys.stderr.isatty():
        with suppress(ImportError):
            from tqdm import tqdm

            items = tqdm(items, name, total, unit=f' {unit}', dynamic_ncols=True)
    return iter(items)


def say(line: str) -> None:
    """Print a line, one also if it holds a file's name of two lines."""
    print(printable(line))


def note(line: str) -> None:
    """Print what the program found out by itself on standard error."""
    print(printable(line), file=sys.stderr)


def warn(line: str) -> None:
    """Print a warning on standard error."""
    print(f'warning: {printable(line)}', file=sys.stderr)


@contextmanager
def tells_what_is_kept(path: Path) -> Iterator[None]:
    """Warn, if a block fails, which new places a map keeps, and how to take them out."""
    before = _session_ids(path)
    try:
        yield
    except BaseException:
        with suppress(MapError):
            after = open_map(path)
            ids = [after.sessions[place.session].id for place in after.places]
            if new := [one for one in ids if one not in before]:
                chosen = ''.join(f' --session {one}' for one in dict.fromkeys(new))
                remedy = f'convseq map remove {quoted_path(str(path))}{chosen}'
                remedy = remedy if before else 'delete it'
                kept = f'keeps the places of this run ({len(new)})'
                warn(f'{path}: {kept}; to take them out: {remedy}')
        raise


def _session_ids(path: Path) -> set[str]:
    with suppress(MapError):
        return {session.id for session in open_map(path).sessions}
    return set()


def quoted(name: str) -> str:
    """Return a name of unknown origin, quoted as one word for a shell."""
    return shlex.quote(printable(name))


def quoted_path(path: str) -> str:
    """Return a path as one word for bash, which reads it back also if it is not printable."""
    if path.isprintable():
        return shlex.quote(path)
    escaped = path.replace('\\', r'\\').replace("'", r'\'')
    return f"$'{printable(escaped)}'"
