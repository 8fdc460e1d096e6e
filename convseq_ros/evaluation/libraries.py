# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loads the libraries that evaluation needs and a robot does not."""

from functools import cache
from importlib import import_module
from typing import Any

from convseq_ros.errors import ConvseqError, pip_install

_PACKAGES = {'sklearn': 'scikit-learn'}


@cache
def load(module: str) -> Any:
    """Return a module of the extra `evaluation`; ConvseqError with the remedy without it."""
    try:
        return import_module(module)
    except ImportError:
        name = module.partition('.')[0]
        package = _PACKAGES.get(name, name)
        raise ConvseqError(f'evaluation needs {package}: {pip_install(package)}') from None
