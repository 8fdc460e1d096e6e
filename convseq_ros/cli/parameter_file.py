# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS parameter file, of which commands read the sections that one vpr_node would read."""

from collections.abc import Iterator, Mapping
from pathlib import Path
import re
from typing import Any

from convseq_ros.config import core_parameters
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import parameters, refuse_unknown
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConfigError, printable
from convseq_ros.io.files import read_yaml

_NODE = '/vpr_node'
_OURS = re.compile(r'.*/(\*\*?|vpr_node)')  # names of sections for any node, or for a vpr_node
_OF_ROS = ('use_sim_time', 'qos_overrides', 'start_type_description_service')
_CORE = [item.name for item in core_parameters()]
_KNOWN = [*_CORE, *(item.name for item in parameters(NodeConfig)), *_OF_ROS]


def read_parameter_file(path: Path, reading: ReadingConfig = ReadingConfig()) -> dict[str, Any]:
    """
    Return the matching parameters of a ROS parameter file, without those of the node.

    A node of another name counts if all its parameters are those of a vpr_node. ConfigError if
    there are several nodes: each reads its own sections, and a command has no name.
    """
    sections = list(_sections(read_yaml(path, reading)))
    ours = [one for one in sections if _OURS.fullmatch(one[0]) or _is_like_ours(one[1])]
    if not ours:
        found = ', '.join(dict.fromkeys(name for name, _ in sections))
        but = printable(f', but with {found}') if found else ''
        raise ConfigError(
            f'{path}: not a ROS parameter file with vpr_node or /**{but}; `convseq config` prints '
            'one to start from'
        )
    names = [name for name, _ in ours]
    node = next((name for name in names if '*' not in name), _NODE)
    if others := [name for name in names if not _pattern(name).fullmatch(node)]:
        several = ', '.join(dict.fromkeys([node, *others]))
        raise ConfigError(
            f'{path}: has sections of several nodes ({printable(several)}); leave those of one, '
            'or make them one of /**'
        )
    values = {name: value for _, part in ours for name, value in part.items()}
    refuse_unknown(values, _KNOWN)
    return {name: value for name, value in values.items() if name in _CORE}


def _sections(tree: Mapping[Any, Any], above: str = '') -> Iterator[tuple[str, dict[Any, Any]]]:
    """Yield the full names of nodes, which may have wildcards, with their parameters."""
    for name, below in tree.items():
        if not isinstance(below, dict):
            continue
        if name == 'ros__parameters' and above:
            yield above, below
        else:
            yield from _sections(below, f'{above}/{str(name).strip("/")}')


def _is_like_ours(part: Mapping[Any, Any]) -> bool:
    return set(part) <= set(_KNOWN) and not set(part).isdisjoint(_CORE)


def _pattern(name: str) -> re.Pattern[str]:
    """Return which nodes a section is for: `*` is a word of their names, `**` any number."""
    words = re.escape(name).replace(r'/\*\*', r'(/[^/]+)*').replace(r'\*', r'[^/]+')
    return re.compile(words)
