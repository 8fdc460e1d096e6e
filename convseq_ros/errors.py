# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exceptions that this package raises on purpose: one clear line each, with the remedy."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import sys
import sysconfig
import traceback
from typing import Any


class ConvseqError(Exception):
    """Base of all; commands print it as one line and exit with 1."""


class ConfigError(ConvseqError):
    """A parameter is unknown, of the wrong type or out of bounds."""


class ImageError(ConvseqError):
    """A single image cannot be decoded; the stream that it came from goes on."""


class FormatError(ImageError):
    """An image is of an encoding or a format that is not read; so are all others of its stream."""


class SourceError(ConvseqError):
    """A folder or recording cannot be read, or holds no images."""


class MapError(ConvseqError):
    """A reference map is missing, foreign, damaged or made with other settings."""


class ModelError(ConvseqError):
    """A descriptor model cannot be used, or failed on an image."""


class FleetError(ConvseqError):
    """Workers do not start, or none of the maps of a fleet can be opened."""


def one_line(error: BaseException, limit: int = 200) -> str:
    """Return an error's message in one line; cut it at `limit` if a library wrote it."""
    line = ' '.join(str(error).split())
    return (line if isinstance(error, ConvseqError | OSError) else line[:limit]) or type(
        error
    ).__name__


def printable(text: str) -> str:
    """Return a text of unknown origin in printable characters; bytes of others in hexadecimal."""
    return ''.join(letter if letter.isprintable() else _escaped(letter) for letter in text)


def _escaped(letter: str) -> str:
    """Return a character's bytes; one that is not UTF-8 in a file's name is a surrogate here."""
    is_of_name = 0xDC80 <= ord(letter) <= 0xDCFF
    encoded = letter.encode('utf-8', 'surrogateescape' if is_of_name else 'surrogatepass')
    return ''.join(f'\\x{byte:02x}' for byte in encoded)


def with_traceback(error: Exception) -> str:
    """Return an error's message, with the traceback if the error is not an expected one."""
    if isinstance(error, ConvseqError | OSError):
        return one_line(error)
    return ''.join(traceback.format_exception(error))


def pip_install(*packages: str) -> str:
    """Return a pip command for this Python; that of apt needs an option, and may have no pip."""
    names = ' '.join(f"'{name}'" if '[' in name else name for name in packages)
    managed = Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED').is_file()
    if managed and sys.prefix == sys.base_prefix:
        apt = '' if find_spec('pip') else 'sudo apt install python3-pip && '
        return f'{apt}pip install --break-system-packages {names} (in a venv, without that option)'
    return f'pip install {names}'


# What pip installs for a module, if that is not of its name.
_PACKAGES = {
    'rosbags': ('rosbags', 'mcap', 'zstandard'), 'skimage': ('scikit-image',),
    'sklearn': ('scikit-learn',), 'yaml': ('pyyaml',),
}  # fmt: skip


def load(module: str, user: object, kind: type[ConvseqError] = ConvseqError) -> Any:
    """Return a module of a library that may be missing; else an error with the remedy."""
    try:
        return import_module(module)
    except ImportError:
        name = module.partition('.')[0]
        packages = _PACKAGES.get(name, (name,))
        raise kind(f'{user} needs {packages[0]}: {pip_install(*packages)}') from None


NO_PLACES = 'has no places; add a drive: convseq build-map RECORDING MAP --append'
NEEDS_ROS = (
    'ROS 2 is not installed or not sourced: source /opt/ros/jazzy/setup.bash, or '
    + pip_install('ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces')
)
