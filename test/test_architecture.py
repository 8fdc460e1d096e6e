# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who may import what, and how labelled a file is."""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
import subprocess
import sys
import sysconfig

import pytest

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
STANDARD_ONLY = (
    'config.py', 'errors.py', 'node_config.py', 'parameter.py', 'process.py', 'reading_config.py',
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


def imported(path: Path) -> Iterator[str]:
    """Yield the top-level name of every import in a file, wherever in the file it is."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name.partition('.')[0]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or '').partition('.')[0]


def is_ros(name: str) -> bool:
    endings = ('_interfaces', '_msgs', '_srvs')
    return name.startswith(('ament_', 'launch', 'rclpy')) or name.endswith(endings)


def test_everything_but_the_node_imports_without_ros_and_optional_libraries():
    absent = ('rclpy', 'ament_index_python', *OPTIONAL)
    result = subprocess.run(
        [sys.executable, '-c', IMPORT_WITHOUT, ','.join(absent)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert {'convseq_ros.config', 'convseq_ros.core.types'} <= set(result.stdout.split())


def test_import_contracts_hold():
    linter = Path(sysconfig.get_path('scripts'), 'lint-imports')
    if not linter.exists():
        pytest.skip('needs import-linter')
    result = subprocess.run(
        [linter, '--no-cache'], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_only_the_node_imports_ros():
    outside = [path for path in MODULES if PACKAGE / 'node' not in path.parents]
    ros = {relative(path): sorted(filter(is_ros, imported(path))) for path in outside}
    assert not {path: names for path, names in ros.items() if names}


@pytest.mark.parametrize('name', STANDARD_ONLY)
def test_parameters_and_errors_need_nothing_but_python(name):
    allowed = sys.stdlib_module_names | {'convseq_ros'}
    assert set(imported(PACKAGE / name)) <= allowed


def imported_modules(path: Path) -> set[str]:
    """Return the modules of ours that a file imports, at once or late, for types or to run."""
    modules = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
        elif isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
    return modules


def test_no_module_of_the_core_imports_itself_in_a_circle():
    of_core = [path for path in MODULES if PACKAGE / 'core' in path.parents]
    paths = {relative(path).removesuffix('.py').replace('/', '.'): path for path in of_core}
    # Importing a module also imports the packages that it lies in; these are empty.
    order = TopologicalSorter(
        {name: imported_modules(path) & paths.keys() for name, path in paths.items()}
    )
    order.prepare()


def test_no_import_is_for_types_alone():
    assert not [relative(path) for path in MODULES if 'TYPE_CHECKING' in path.read_text()]


def tells_of_itself(path: Path) -> bool:
    text = path.read_text()
    return text.splitlines()[:2] == HEADER and bool(ast.get_docstring(ast.parse(text)))


def test_a_file_says_whose_it_is_and_what_it_does():
    files = [REPOSITORY / 'setup.py', *MODULES, *SCRIPTS]
    assert not [relative(path) for path in files if not tells_of_itself(path)]
