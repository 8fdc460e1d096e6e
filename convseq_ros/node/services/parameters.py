# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters, declared from `convseq_ros.config` under their flat names."""

from collections.abc import Callable, Mapping, Sequence
import sys
from typing import Any, TypeVar

from convseq_ros.config import Config, core_parameters, make_config, make_group
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import Parameter, parameters, refuse_unknown
from convseq_ros.errors import ConfigError
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

KNOWN = {item.name: item for item in (*core_parameters(), *parameters(NodeConfig))}
_CORE = frozenset(item.name for item in core_parameters())
_CLOCK = 'use_sim_time'
_OF_ROS = (_CLOCK, 'start_type_description_service')
_OF_ROS_PREFIX = 'qos_overrides.'
_INT64_MAX = 2**63 - 1

Listener = Callable[[Config, NodeConfig], None]
Group = TypeVar('Group')


def declare(node: Node, on_change: Listener) -> tuple[Config, NodeConfig]:
    """
    Declare every parameter and return the values that the user chose.

    `on_change` receives both configurations whenever a dynamic parameter was set. ConfigError if a
    name is unknown or a value is not allowed.
    """
    values = _declared(node, KNOWN)
    configs = _configs(values)

    def check(changes: Sequence[RosParameter]) -> SetParametersResult:
        ours = {item.name: item.value for item in changes if item.name in KNOWN}
        try:
            _configs(_current(node) | ours)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def announce(changes: Sequence[RosParameter]) -> None:
        for item in changes:
            if item.name in KNOWN and item.value != values[item.name]:
                was, values[item.name] = values[item.name], item.value
                node.get_logger().info(f'{item.name} is now {item.value!r}; it was {was!r}')
        if any(item.name in KNOWN for item in changes):
            on_change(*_configs(_current(node)))

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(announce)
    return configs


class _Unknown(ParameterNotDeclaredException):
    """A parameter is unknown; the services of ROS answer with this line."""

    def __init__(self, line: str) -> None:
        Exception.__init__(self, line)


def declare_group(node: Node, kind: type[Group]) -> Group:
    """Declare the parameters of one group alone, which only a start sets, and return it."""
    return make_group(kind, _declared(node, {item.name: item for item in parameters(kind)}))


def _declared(node: Node, known: Mapping[str, Parameter]) -> dict[str, Any]:
    """
    Declare parameters, and return their values; ConfigError as of `declare`.

    Another clock, and unknown names, are refused from then on.
    """
    chosen = _overrides(node)
    refuse_unknown(chosen, known)
    values = {name: item.check(chosen.get(name, item.default)) for name, item in known.items()}
    for name, value in values.items():
        if name in chosen:
            node.undeclare_parameter(name)
        node.declare_parameter(name, value, descriptor(known[name]), ignore_override=True)

    def prepare(changes: list[RosParameter]) -> list[RosParameter]:
        try:
            refuse_unknown([it.name for it in changes if not node.has_parameter(it.name)], known)
        except ConfigError as error:
            node.get_logger().warning(str(error))
            raise _Unknown(str(error)) from None
        return _whole_numbers_to_floats(changes, known)

    def keep_clock(changes: Sequence[RosParameter]) -> SetParametersResult:
        for item in changes:
            # With another clock, stamps and the times of a growing map would jump.
            if item.name == _CLOCK and item.value != node.get_parameter(_CLOCK).value:
                reason = f'{_CLOCK} may only be set at the start: -p {_CLOCK}:=true'
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    node.add_pre_set_parameters_callback(prepare)
    node.add_on_set_parameters_callback(keep_clock)
    return values


def descriptor(item: Parameter) -> ParameterDescriptor:
    """Return the description of a parameter for `ros2 param describe`."""
    text = item.doc + (f' Unit: {item.unit}.' if item.unit else '')
    result = ParameterDescriptor(
        name=item.name,
        description=text,
        additional_constraints=f'One of {item.bounds}.' if item.choices else '',
        read_only=not item.dynamic,
    )
    if item.low is None and item.high is None:
        return result
    if item.type is float:
        low = -sys.float_info.max if item.low is None else float(item.low)
        high = sys.float_info.max if item.high is None else float(item.high)
        result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    else:
        first = -_INT64_MAX if item.low is None else int(item.low)
        last = _INT64_MAX if item.high is None else int(item.high)
        result.integer_range = [IntegerRange(from_value=first, to_value=last, step=1)]
    return result


def _overrides(node: Node) -> dict[str, Any]:
    """Return the parameters from the command line and parameter files, without those of ROS."""
    names = node.list_parameters([], depth=0).names
    return {
        name: node.get_parameter(name).value
        for name in names
        if name not in _OF_ROS and not name.startswith(_OF_ROS_PREFIX)
    }


def _current(node: Node) -> dict[str, Any]:
    return {name: node.get_parameter(name).value for name in KNOWN}


def _configs(values: Mapping[str, Any]) -> tuple[Config, NodeConfig]:
    core = {name: value for name, value in values.items() if name in _CORE}
    return make_config(core), make_group(NodeConfig, values)


def _whole_numbers_to_floats(
    changes: list[RosParameter], known: Mapping[str, Parameter]
) -> list[RosParameter]:
    """Convert 1 to 1.0 where a float is needed, which rclpy does not do."""
    return [
        RosParameter(item.name, value=float(item.value))
        if item.name in known
        and known[item.name].type is float
        and item.type_ is RosParameter.Type.INTEGER
        else item
        for item in changes
    ]
