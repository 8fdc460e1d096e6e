# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One layout for three users: `pip install .`, `pip install '.[ros]'` and `colcon build`."""

from glob import glob
from pathlib import Path
import re
import sys

from setuptools import Extension, find_packages, setup

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # Ubuntu 24.04's setuptools; colcon makes no wheels
    bdist_wheel = object
NAME = 'convseq_ros'
CORE = Path(NAME, 'core')
VERSION = re.search(r"__version__ = '(.+)'", Path(NAME, '__init__.py').read_text())[1]

# The same sums on all processors: products are fused with sums only where the source says so.
# Instructions stay in their order: on ARM GCC would move loads ahead and run out of registers.
COMPILE = (
    '-std=gnu11 -O3 -fno-schedule-insns -ffp-contract=off -fno-math-errno '
    '-fno-trapping-math -fvisibility=hidden -Wall -Wextra -Wno-psabi'
)
# A compiler that is missing or fails is no error: NumPy computes what C would have. Python loads
# the library by ctypes, so that it needs no headers of Python's and serves all versions of it.
NATIVE = Extension(
    f'{NAME}.core._native',
    sorted(map(str, CORE.glob('native/*.c'))),
    depends=sorted(map(str, [*CORE.glob('native/*.h'), *CORE.glob('*/**/*.c')])),
    extra_compile_args=COMPILE.split(),
    extra_link_args=['-lm'],
    py_limited_api=True,
    optional=True,
)


class AnyPython(bdist_wheel):
    """A wheel for all versions of Python; for all processors, too, if nothing was compiled."""

    def get_tag(self):
        library = Path(self.bdist_dir, CORE).glob('_native*')
        return 'py3', 'none', super().get_tag()[2] if any(library) else 'any'


# colcon puts programs where `ros2 run` looks; scripts/convseq leads there from PATH. In a wheel it
# would be in the way of the program itself.
IS_WHEEL = any(argument.endswith('wheel') for argument in sys.argv)

setup(
    name=NAME,
    version=VERSION,
    description="Training-free visual place recognition and loop closure on a robot's CPU",
    author='The convseq_ros authors',
    maintainer='The convseq_ros authors',
    maintainer_email='convseq_ros@users.noreply.github.com',
    license='Apache-2.0',
    keywords=['ROS', 'place recognition', 'loop closure', 'SLAM'],
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: [
            'py.typed',
            'core/encoding/projection.*',
            'core/similarity/kernels/README.md',
            'data_sets/*.yaml',
        ],
        f'{NAME}.evaluation.report': ['*.html'],
    },
    ext_modules=[NATIVE],
    cmdclass={'bdist_wheel': AnyPython} if bdist_wheel is not object else {},
    include_package_data=False,
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', sorted(glob('config/*'))),
        (f'share/{NAME}/launch', sorted(glob('launch/*.launch.py'))),
        (f'lib/{NAME}', ['scripts/vpr_node', 'scripts/pose_graph_node']),
        *([] if IS_WHEEL else [('bin', ['scripts/convseq'])]),
    ],
    # The lowest versions are those of Ubuntu 24.04. colcon installs none of these: with apt's
    # python3-opencv, never let pip add opencv-python-headless (use colcon, or pip --no-deps).
    install_requires=[
        'mcap>=1.2',
        'numpy>=1.26',
        'opencv-python-headless>=4.6',
        'pyyaml>=6.0',
        'rosbags>=0.11',
        'tqdm>=4.66',
        'zstandard>=0.22',
    ],
    extras_require={
        # The unversioned wheel `ros-rclpy` would be a newer ROS than Jazzy.
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        # pages of `convseq replay --report` and `convseq demo`
        'plot': ['jinja2>=3.1', 'matplotlib>=3.6'],
        # convseq evaluate; scikit-image is for the method hog
        'evaluation': [
            'jinja2>=3.1',
            'matplotlib>=3.6',
            'pandas>=2.1',
            'scikit-image>=0.22',
            'scikit-learn>=1.4',
        ],
        'onnx': ['onnxruntime'],
        'fleet': ['distributed>=2026.1'],  # convseq fleet
        'slam': ['gtsam>=4.3'],  # pose_graph_node, convseq map link
        'test': [
            'distributed>=2026.1',
            "evo>=1.30; python_version >= '3.11'",
            'hypothesis>=6.98',
            'jinja2>=3.1',
            'matplotlib>=3.6',
            'onnx',
            'onnxruntime',
            'pandas>=2.1',
            "pyhbst>=0.2; platform_machine == 'x86_64' and python_version < '3.14'",
            'pytest>=7.4',
            'pytest-timeout>=2.2',
            'pytest-xdist>=3.4',
            'scikit-image>=0.22',
            'scikit-learn',
        ],
        # `make torture`; where there is no wheel, decoders are not fuzzed
        'torture': ["atheris>=3; platform_machine == 'x86_64' and python_version < '3.15'"],
        'docs': ['mkdocs-material>=9.5', 'mkdocstrings[python]>=0.26', 'ruff>=0.6'],
        'dev': [
            'bandit>=1.7',
            'catkin_pkg',
            'check-jsonschema',
            'colcon-common-extensions',
            'import-linter>=2.1',
            'mypy>=1.11',
            'onnx',  # scripts/make_onnx_model.py
            'pytest-cov',
            'ruff>=0.6',
            'types-PyYAML',
            'yamllint',
        ],
    },
    entry_points={
        'console_scripts': [
            f'convseq = {NAME}.cli.__main__:main',
            f'vpr_node = {NAME}.node.__main__:main',
            f'pose_graph_node = {NAME}.node.__main__:pose_graph_main',
        ]
    },
)
