# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What mkdocs does not know: links to files of the repository, and the commands' help."""

import argparse
from contextlib import redirect_stdout, suppress
from importlib import import_module
import io
import os
from pathlib import Path
import re
from typing import Any

from convseq_ros.cli import COMMANDS, main

_REPOSITORY = Path(__file__).resolve().parents[1]
_LINK = re.compile(r'(?<!!)\[([^\]]+)\]\(([^)#:\s]+)(#[^)\s]*)?\)')
_COMMANDS = '<!-- the help of every command -->'


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return a page's text without links out of the documentation, and with what it includes."""
    if _COMMANDS in markdown:
        markdown = markdown.replace(_COMMANDS, commands())
    folder = (_REPOSITORY / 'docs' / page.file.src_uri).parent

    def plain(link: re.Match[str]) -> str:
        target = Path(os.path.normpath(folder / link[2]))
        if target.is_relative_to(_REPOSITORY / 'docs') and target.suffix != '.py':
            return link[0]
        if not target.exists():
            from mkdocs.exceptions import PluginError

            raise PluginError(f'{page.file.src_uri}: {link[2]} does not exist')
        return f'{link[1]} (`{target.relative_to(_REPOSITORY)}` of the repository)'

    return _LINK.sub(plain, markdown)


def commands() -> str:
    """Return what every sub-command says of itself."""
    os.environ['COLUMNS'] = '96'
    parts = []
    for name, text in COMMANDS.items():
        parts.append(_section(name, text))
        command = import_module(f'convseq_ros.cli.{name.replace("-", "_")}')
        command.describe(parser := argparse.ArgumentParser(allow_abbrev=False))
        for verbs in (one for one in parser._actions if one.nargs == argparse.PARSER):
            parsers: Any = verbs.choices or {}
            for own in parsers:
                parts.append(_section(f'{name} {own}', parsers[own].description or ''))
    return '\n'.join(parts)


def _section(name: str, text: str) -> str:
    told = io.StringIO()
    with redirect_stdout(told), suppress(SystemExit):
        main([*name.split(), '--help'])
    return (
        f'## convseq {name}\n\n{text.capitalize().rstrip(".")}.\n\n```text\n{told.getvalue()}```\n'
    )
