# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data in a page of pairs, and the page as a browser shows it."""

import json
from pathlib import Path
import re
import shutil
import subprocess

import pytest

OPTIONS = (
    '--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --dump-dom '
    '--disable-background-networking --virtual-time-budget=4000 --window-size=1000,900'
).split()


def data_of(page: Path) -> dict:
    text = page.read_text(encoding='utf-8')
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])


def shown(page: Path, script: str = '', address: str = '') -> str:
    """Open a page at an address, run a script, and return what is there then."""
    browser = next(filter(None, map(shutil.which, ('chromium', 'google-chrome'))), None)
    if not browser:
        pytest.skip('needs chromium on the PATH')
    copy = page.with_name('shown.html')
    copy.write_text(page.read_text('utf-8') + f'<script>{script}</script>', 'utf-8')
    profile = f'--user-data-dir={page.with_name("profile")}'
    command = [browser, *OPTIONS, profile, copy.as_uri() + address]
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
