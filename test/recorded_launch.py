# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of `launch`, which PyPI has not, replaced by what records how they are made."""

from pathlib import Path
import sys
import types


class Recorded:
    def __init__(self, *args, **kwargs):
        self.args, self.kwargs = args, kwargs


class Configuration(Recorded):
    def perform(self, context):
        return context.get(self.args[0], self.kwargs.get('default', ''))


def record_launch(monkeypatch, share):
    """Have launch files import these parts, and find the package's share at a path."""
    actions = 'DeclareLaunchArgument', 'IncludeLaunchDescription', 'OpaqueFunction'
    names = {
        'ament_index_python.packages': {'get_package_share_directory': lambda _: share},
        'launch': {'LaunchDescription': Recorded},
        'launch.actions': dict.fromkeys(actions, Recorded),
        'launch.launch_description_sources': {'PythonLaunchDescriptionSource': Path},
        'launch.substitutions': {'LaunchConfiguration': Configuration},
        'launch_ros.actions': {'Node': Recorded},
        'launch_ros.parameter_descriptions': {
            'ParameterValue': lambda value, value_type: value_type(value)
        },
    }
    for name, content in names.items():
        module = types.ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)


def generator_of(path):
    """Return the function of a launch file that generates its description."""
    namespace = {'__file__': str(path)}
    exec(compile(path.read_text(), str(path), 'exec'), namespace)
    return namespace['generate_launch_description']
