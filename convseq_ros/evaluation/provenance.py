# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The provenance of a result: versions, machine, commit and date."""

from datetime import datetime, UTC
from functools import cache
import hashlib
from importlib import metadata
import os
from pathlib import Path
import platform
import subprocess  # nosec B404
from typing import Any

from convseq_ros import __version__

_LIBRARIES = ('numpy', 'opencv-python-headless', 'opencv-python', 'scikit-image', 'onnxruntime')


def provenance() -> dict[str, Any]:
    """Return versions, machine, commit and date, ready for JSON."""
    return {
        'versions': {
            'convseq_ros': __version__,
            'python': platform.python_version(),
            **{name: version for name in _LIBRARIES if (version := version_of(name))},
        },
        'machine': {
            'cpu': processor() or platform.processor() or platform.machine(),
            'cores': os.cpu_count(),
            'system': platform.platform(),
        },
        'commit': _commit(),
        'date': datetime.now(UTC).isoformat(timespec='seconds'),
    }


@cache
def program() -> str:
    """Return a text that differs if programs or the processor may compute other numbers."""
    sources, folder = hashlib.sha256(), Path(__file__).resolve().parents[1]
    for path in sorted(folder.rglob('*')):
        if path.suffix in ('.py', '.so'):
            sources.update(f'{path.relative_to(folder)}'.encode() + path.read_bytes())
    return f'{provenance()["versions"]} {processor()} {sources.hexdigest()}'


def _commit() -> str | None:
    """Return the commit of the source tree, with -dirty if changed; None outside a checkout."""
    folder = Path(__file__).resolve().parent
    command = ['git', '-C', str(folder), 'describe', '--always', '--dirty', '--abbrev=40']
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=10)  # nosec B603
    except (OSError, subprocess.TimeoutExpired):
        return None
    return result.stdout.strip() or None


def short(commit: str | None) -> str:
    """Return a commit of `provenance` as pages tell it; a tree that was changed says so."""
    if commit is None:
        return 'an unknown commit'
    number, _, changed = commit.partition('-')
    return '-'.join(filter(None, (number[:8], changed)))


def version_of(*names: str) -> str:
    """Return the version of the first package that is installed; empty if none is."""
    for name in names:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return ''


def processor() -> str:
    """Return the processor's name from /proc/cpuinfo; empty without one, as on ARM."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8', errors='replace').splitlines()
    except OSError:
        return ''
    named = (line.partition(':')[2].strip() for line in lines if line.startswith('model name'))
    return next(named, '')
