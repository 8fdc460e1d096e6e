# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that name files to write, which are checked before a command starts."""

import argparse
from pathlib import Path
from typing import Any

from convseq_ros.io.output_file import OutputFile, refuse_outputs, TEXT


def add_output(
    parser: argparse.ArgumentParser, *names: str, kinds: tuple[str, ...] = TEXT, **more: Any
) -> None:
    """Add an option for a file to write, which `refuse_chosen_outputs` checks."""
    action = parser.add_argument(*names, type=Path, **more)
    declared = parser.get_default('outputs') or {}
    parser.set_defaults(outputs={**declared, action.dest: (names[-1], kinds)})


def refuse_chosen_outputs(chosen: argparse.Namespace) -> None:
    """Raise a ConfigError for an output that cannot be written, or replaces what else is named."""
    values, declared = vars(chosen), getattr(chosen, 'outputs', {})
    others = [value for name, value in values.items() if name not in declared]
    words = [word for one in others for word in (one if isinstance(one, list) else [one])]
    refuse_outputs(
        (
            OutputFile(option, values[name], kinds)
            for name, (option, kinds) in declared.items()
            if values[name]
        ),
        [Path(word) for word in words if isinstance(word, str | Path)],
    )
