# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package as its users meet it: pip, pip with ROS, colcon, and the six names in Python."""

import ast
from importlib import metadata
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as xml

import convseq_ros
from convseq_ros.simulation.recording import write_recording
from drives import small_drive
from programs import run
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDERS = 'bench', 'convseq_ros', 'examples', 'launch', 'scripts', 'test'
HEADER = ['# Copyright 2026 The convseq_ros authors', '# SPDX-License-Identifier: Apache-2.0']
OPTIONAL = (
    'dask', 'distributed', 'jinja2', 'lz4', 'matplotlib', 'mcap', 'pandas', 'pyhbst', 'rosbags',
    'skimage', 'sklearn', 'tqdm', 'yaml', 'zstandard',
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
from convseq_ros.core.compiled import available

for module in pkgutil.walk_packages(convseq_ros.__path__, 'convseq_ros.'):
    if module.name.endswith('._native'):
        continue  # a library for ctypes, not a module
    if module.name.endswith('.kernels.coherent') and not available():
        continue  # is imported only where a kernel is
    if module.name.split('.')[1] != 'node' and not module.name.endswith('__main__'):
        importlib.import_module(module.name)
        print(module.name)
"""


def test_everything_but_the_node_imports_without_ros_and_optional_libraries():
    absent = ('rclpy', 'ament_index_python', *OPTIONAL)
    result = run(sys.executable, '-c', IMPORT_WITHOUT, ','.join(absent))
    assert result.returncode == 0, result.stderr
    assert {'convseq_ros.config', 'convseq_ros.core.types'} <= set(result.stdout.split())


def has_header_and_docstring(path: Path) -> bool:
    text = path.read_text()
    return text.splitlines()[:2] == HEADER and bool(ast.get_docstring(ast.parse(text)))


def test_every_file_has_a_copyright_a_licence_and_a_docstring():
    files = [path for folder in FOLDERS for path in (REPOSITORY / folder).rglob('*.py')]
    assert not [
        path for path in (REPOSITORY / 'setup.py', *files) if not has_header_and_docstring(path)
    ]


SCRIPTS = Path(sysconfig.get_path('scripts'))
NOT_SOURCE = shutil.ignore_patterns(
    '.*', 'build', 'dist', 'install', 'log', 'site', 'test', '*.egg-info'
)


@pytest.fixture(scope='module')
def manifest() -> xml.Element:
    return xml.parse(REPOSITORY / 'package.xml').getroot()


@pytest.fixture(scope='module')
def workspace(tmp_path_factory) -> Path:
    """Return a workspace in which colcon has built a copy of the sources."""
    if not (SCRIPTS / 'colcon').exists():
        pytest.skip('needs colcon-common-extensions in this environment')
    root = tmp_path_factory.mktemp('workspace')
    shutil.copytree(REPOSITORY, root / 'src' / 'convseq_ros', ignore=NOT_SOURCE)
    result = colcon(root, 'build')
    assert result.returncode == 0, result.stdout + result.stderr
    return root


def colcon(root: Path, *verb: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {'PYTHONWARNINGS': 'ignore', 'COLCON_LOG_PATH': str(root / 'log')}
    return run(SCRIPTS / 'colcon', *verb, cwd=root, env=environment)


def find_executable(prefix: Path, name: str) -> Path:
    """Return what `ros2 run convseq_ros NAME` would execute from this prefix."""
    assert (prefix / 'share/ament_index/resource_index/packages/convseq_ros').is_file()
    path = prefix / 'lib' / 'convseq_ros' / name
    assert path.is_file()
    assert os.access(path, os.X_OK)
    return path


def files_of(folder: Path) -> set[str]:
    """Return what belongs to the package: not what C is compiled from, and to."""
    paths = (path.relative_to(folder) for path in folder.rglob('*') if path.is_file())
    compiled = '.c', '.h', '.so'
    return {
        path.as_posix()
        for path in paths
        if '__pycache__' not in path.parts and path.suffix not in compiled
    }


def assert_shared_files_are_in(prefix: Path) -> None:
    shared = prefix / 'share' / 'convseq_ros'
    assert (shared / 'package.xml').is_file()
    for folder in ('config', 'launch'):
        expected = {path.name for path in (REPOSITORY / folder).iterdir() if path.is_file()}
        assert expected == {path.name for path in (shared / folder).iterdir() if path.is_file()}


def assert_node_reports_a_missing_map(command: list[str], environment: dict[str, str]) -> None:
    result = run(*command, '--ros-args', '-p', 'map_path:=absent.db', env=environment, timeout=180)
    assert result.returncode == 1, result.stderr
    assert 'absent.db' in result.stderr
    assert 'Traceback' not in result.stderr


def test_version_is_the_same_everywhere(manifest):
    source = (REPOSITORY / 'convseq_ros' / '__init__.py').read_text()
    citation = (REPOSITORY / 'CITATION.cff').read_text()
    version = re.search(r"__version__ = '(.+)'", source)[1]
    assert manifest.findtext('version') == version
    assert re.search(r'^version: (.+)$', citation, re.MULTILINE)[1] == version


def test_every_ros_package_in_use_is_a_dependency(manifest):
    names = r'rclpy|ament_index_python|\w+_interfaces|\w+_msgs|\w+_srvs'
    pattern = re.compile(rf'^\s*(?:from|import) ({names})\b', re.MULTILINE)
    sources = (REPOSITORY / 'convseq_ros').rglob('*.py')
    used = {name for path in sources for name in pattern.findall(path.read_text())}
    assert used == {
        item.text for item in manifest.iter('exec_depend') if pattern.match(f'import {item.text}')
    }


def test_manifest_is_that_of_an_ament_python_package():
    package = pytest.importorskip('catkin_pkg.package')
    parsed = package.parse_package(REPOSITORY / 'package.xml', warnings=(warnings := []))
    assert parsed.get_build_type() == 'ament_python'
    assert parsed.licenses == ['Apache-2.0']
    assert not warnings


@pytest.fixture
def wheel() -> metadata.Distribution:
    """Return what pip installed; colcon makes no wheel, and lists the sources' files instead."""
    try:
        installed = metadata.distribution('convseq_ros')
    except metadata.PackageNotFoundError:
        pytest.skip('convseq_ros is not installed in this environment')
    if installed.read_text('WHEEL') is None:
        pytest.skip('convseq_ros is not installed from a wheel')
    return installed


def test_pip_installs_what_ros2_run_executes(manifest, wheel):
    assert wheel.version == manifest.findtext('version')
    prefix = Path(sys.prefix)
    installed = Path(convseq_ros.__file__).parent
    assert prefix in installed.parents, 'the tests must run against what pip installed'
    assert files_of(installed) == files_of(REPOSITORY / 'convseq_ros')
    node = find_executable(prefix, 'vpr_node')
    assert_shared_files_are_in(prefix)
    assert (SCRIPTS / 'convseq').is_file()
    pytest.importorskip('rclpy')
    assert_node_reports_a_missing_map([str(node)], dict(os.environ))


def test_one_wheel_of_the_package_alone_serves_every_python(wheel):
    assert re.search(r'^Tag: py3-none-\w+$', wheel.read_text('WHEEL'), re.MULTILINE)
    tops = {file.parts[0] for file in wheel.files or () if file.suffix == '.py'}
    assert tops <= {'convseq_ros', '..'}  # the second is a launch file in share


def test_colcon_installs_what_ros2_run_executes(workspace):
    prefix = workspace / 'install' / 'convseq_ros'
    node = find_executable(prefix, 'vpr_node')
    assert_shared_files_are_in(prefix)
    assert node.read_text().startswith(f'#!{sys.executable}')
    pytest.importorskip('rclpy')
    sourced = f'. {workspace}/install/setup.sh && exec {node} "$@"'
    assert_node_reports_a_missing_map(['sh', '-c', sourced, 'vpr_node'], dict(os.environ))


# What `ros2 run` executes, found as it finds it; the command itself is not on PyPI.
ROS2_RUN = """ros2() {
    for prefix in $(echo "$AMENT_PREFIX_PATH" | tr ':' ' '); do
        if [ -f "$prefix/share/ament_index/resource_index/packages/$2" ]; then
            program="$prefix/lib/$2/$3"; shift 3; exec "$program" "$@"
        fi
    done
}
"""


def test_the_robot_block_of_the_readme_works(workspace):
    """Build, map and run, as it is written there; the first drive is drawn, the camera absent."""
    pytest.importorskip('rclpy')
    pytest.importorskip('rosbags')
    readme = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
    (block,) = re.findall(r'```bash\n(colcon build.*?)```', readme, re.DOTALL)
    _build, _install, make, start = block.splitlines()
    drawn = small_drive()
    write_recording(workspace / 'first_drive.mcap', drawn)
    # The workspace is built already, by the same command but for this package's name.
    sourced = f'set -e; source install/setup.bash; {ROS2_RUN}'
    made = run('bash', '-c', f'{sourced} which convseq; {make}', cwd=workspace)
    assert made.returncode == 0, made.stdout + made.stderr
    assert made.stdout.startswith(f'{workspace}/install/convseq_ros/bin/convseq\n')
    assert 'map.db: ' in made.stdout + made.stderr and (workspace / 'map.db').is_file()
    with subprocess.Popen(
        ['bash', '-c', f'{sourced} {start}'], cwd=workspace, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as node:  # fmt: skip
        for line in node.stdout:
            if 'listening to /camera/image_raw' in line:
                node.send_signal(signal.SIGINT)
    assert node.returncode == 0


def test_ros_plugins_of_pytest_leave_our_tests_alone(tmp_path):
    for name in ('launch_ros', 'launch_testing'):
        (tmp_path / f'{name}.py').write_text('raise SystemExit("loaded")')
        about = tmp_path / f'{name}-1.dist-info'
        about.mkdir()
        (about / 'METADATA').write_text(f'Name: {name}\nVersion: 1\n')
        (about / 'entry_points.txt').write_text(f'[pytest11]\n{name} = {name}\n')
    environment = os.environ | {'PYTHONPATH': os.pathsep.join([str(tmp_path), *sys.path])}
    words = '--collect-only', '--quiet', 'test/test_config.py'
    result = run(sys.executable, '-m', 'pytest', *words, cwd=REPOSITORY, env=environment)
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_six_names_are_all_that_is_public():
    assert sorted(convseq_ros.__all__) == sorted(
        ['Config', 'Frame', 'Match', 'PlaceRecognizer', 'build_map', 'open_map']
    )
    assert set(convseq_ros.__all__) <= set(dir(convseq_ros))
    assert all(name in convseq_ros.__doc__ for name in convseq_ros.__all__)
    with pytest.raises(AttributeError, match='no attribute'):
        _ = convseq_ros.nothing_of_the_kind


@pytest.mark.parametrize(
    ('module', 'heavy'),
    [('convseq_ros', {'numpy', 'cv2', 'yaml'}), ('convseq_ros.node.vpr_node', {'gtsam'})],
)
def test_importing_a_module_loads_nothing_heavy(module, heavy):
    if '.' in module:
        pytest.importorskip('rclpy', reason='needs ROS')
    result = run(
        sys.executable, '-c', f'import sys, {module}; print({heavy} & sys.modules.keys())'
    )
    assert result.stdout.split()[-1] == 'set()', result.stderr
