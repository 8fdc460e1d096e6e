# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What imports without ROS and what is optional, and how labelled a file is."""

import ast
from pathlib import Path
import sys

from programs import run

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGE = REPOSITORY / 'convseq_ros'
MODULES = sorted(PACKAGE.rglob('*.py'))
SCRIPTS = [
    path
    for folder in ('bench', 'examples', 'launch', 'scripts', 'test')
    for path in sorted((REPOSITORY / folder).rglob('*.py'))
]
HEADER = ['# Copyright 2026 The convseq_ros authors', '# SPDX-License-Identifier: Apache-2.0']
OPTIONAL = (
    'dask', 'distributed', 'lz4', 'matplotlib', 'mcap', 'rosbags', 'skimage', 'tqdm', 'yaml',
    'zstandard',
)  # fmt: skip
# Refuses the first argument's packages, then imports every module of ours outside node/.
IMPORT_WITHOUT = """
import importlib, pkgutil, sys

absent = set(sys.argv[1].split(','))

class Absent:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if top in absent or top.endswith(('_interfaces', '_msgs', '_srvs')):
            raise ImportError(name + ' is absent in this test')

assert not absent & sys.modules.keys()
sys.meta_path.insert(0, Absent())
import convseq_ros

for module in pkgutil.walk_packages(convseq_ros.__path__, 'convseq_ros.'):
    if module.name.endswith('._native'):
        continue  # a library for ctypes, not a module
    if module.name.split('.')[1] != 'node' and not module.name.endswith('__main__'):
        importlib.import_module(module.name)
        print(module.name)
"""


def relative(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


def test_everything_but_the_node_imports_without_ros_and_optional_libraries():
    absent = ('rclpy', 'ament_index_python', *OPTIONAL)
    result = run(sys.executable, '-c', IMPORT_WITHOUT, ','.join(absent))
    assert result.returncode == 0, result.stderr
    assert {'convseq_ros.config', 'convseq_ros.core.types'} <= set(result.stdout.split())


def tells_of_itself(path: Path) -> bool:
    text = path.read_text()
    return text.splitlines()[:2] == HEADER and bool(ast.get_docstring(ast.parse(text)))


def test_a_file_says_whose_it_is_and_what_it_does():
    files = [REPOSITORY / 'setup.py', *MODULES, *SCRIPTS]
    assert not [relative(path) for path in files if not tells_of_itself(path)]
