# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings as ROS parameters: declared, described, checked as a whole, swapped as a whole."""

from array import array
from collections.abc import Callable, Mapping, Sequence
import math
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from plc_inspect.config import HazardSettings, Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.catalogue import make_rules, read_rules
from plc_inspect.ros.background.saving import check_output
from plc_inspect.setting_names import describe, update


def make_descriptor(default: Any, meta: Mapping[str, Any]) -> ParameterDescriptor:
    """
    Describe one setting.

    Parameters
    ----------
    default : Any
        Its default.
    meta : Mapping
        As from ``setting_names.describe``.

    Returns
    -------
    ParameterDescriptor

    """
    unit = f' [{meta["unit"]}]' if meta['unit'] else ''
    descriptor = ParameterDescriptor(
        description=meta['description'] + unit, read_only=meta['structural']
    )
    if meta['choices']:
        descriptor.additional_constraints = 'one of ' + ', '.join(meta['choices'])
    if isinstance(default, bool):
        return descriptor
    if isinstance(default, float) and math.isfinite(meta['low']):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(meta['low']), to_value=float(meta['high']))
        ]
    elif isinstance(default, int):
        descriptor.integer_range = [
            IntegerRange(from_value=int(meta['low']), to_value=int(meta['high']), step=1)
        ]
    return descriptor


class Parameters:
    """
    The settings of a node.

    Integers are taken where a number with a fraction is meant.  A set of parameters that changes
    at once is checked as a whole and takes effect as a whole.

    Parameters
    ----------
    node : Node
        Gets the parameters.
    changed : callable
        Called with the new settings after a change.

    Raises
    ------
    ConfigError
        What was given at the start is no parameter, has the wrong type, is out of range, or names
        rules that cannot be read or a folder that cannot be written.

    """

    def __init__(self, node: Node, changed: Callable[[Settings], object]) -> None:
        self._node = node
        self._changed = changed
        self._defaults = {name: default for name, default, _ in describe()}
        values = {
            name: self._declare(name, default, make_descriptor(default, meta))
            for name, default, meta in describe()
        }
        self.settings = update(Settings(), values)
        self._refuse_unknown()
        check_output(self.settings.output)
        hazards = self.settings.hazards
        self._content = read_rules(hazards.rules)
        self.rules = make_rules(self._content, hazards)
        """Clearance rules that the settings name."""
        self._read = hazards, self.rules, self._content
        node.add_pre_set_parameters_callback(self._widen)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._swap)

    def _refuse_unknown(self) -> None:
        given = getattr(self._node, '_parameter_overrides', {})
        unknown = [
            name for name in given
            if not self._node.has_parameter(name) and not name.startswith('qos_overrides.')
        ]
        if unknown:
            raise ConfigError(f'unknown parameter {unknown[0]}')

    def _declare(self, name: str, default: Any, descriptor: ParameterDescriptor) -> Any:
        value = list(default) if isinstance(default, tuple) else default
        try:
            return self._node.declare_parameter(name, value, descriptor).value
        except InvalidParameterTypeException:
            given = self._read_override(name)
            widened = _widen(given, default)
            if widened is given:
                raise ConfigError(
                    f'parameter {name} must be like {value!r}, got {given!r}'
                ) from None
            try:
                return self._node.declare_parameter(
                    name, widened, descriptor, ignore_override=True
                ).value
            except InvalidParameterValueException as error:
                raise ConfigError(_explain(name, widened, descriptor, error)) from None
        except InvalidParameterValueException as error:
            given = self._read_override(name)
            raise ConfigError(_explain(name, given, descriptor, error)) from None

    def _read_override(self, name: str) -> Any:
        """Return the value that was given for a parameter; declared untyped under the hood."""
        probe = ParameterDescriptor(dynamic_typing=True)
        value = self._node.declare_parameter(name, descriptor=probe).value
        self._node.undeclare_parameter(name)
        return value

    def _widen(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Turn integers into floats where those are meant, before anything is checked."""
        result = []
        for item in parameters:
            widened = _widen(item.value, self._defaults.get(item.name))
            result.append(
                item if widened is item.value else Parameter(item.name, value=widened)
            )
        return result

    def _updated(self, parameters: Sequence[Parameter]) -> Settings:
        return update(
            self.settings,
            {
                item.name: list(item.value) if isinstance(item.value, array) else item.value
                for item in parameters if item.name in self._defaults
            },
        )

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            settings = self._updated(parameters)
            self._refuse_paths(settings)
            self._read_rules(settings.hazards)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _read_rules(self, settings: HazardSettings) -> RuleSet:
        """Return the rules that some settings name; a file is read once, when it is set."""
        if settings != self._read[0]:
            same = settings.rules == self.settings.hazards.rules
            content = self._content if same else read_rules(settings.rules)
            self._read = settings, make_rules(content, settings), content
        return self._read[1]

    def _log_changes(self, settings: Settings) -> None:
        """Leave a trace of what was changed in flight; the log has the time."""
        for name in self._defaults:
            section, _, key = name.partition('.')
            old, new = (getattr(getattr(item, section), key) for item in (self.settings, settings))
            if old != new:
                self._node.get_logger().warning(f'parameter {name} was {old!r}, is {new!r}')

    def _refuse_paths(self, settings: Settings) -> None:
        """Refuse a file in flight: whoever may set parameters may not read the vehicle's files."""
        rules = settings.hazards.rules
        if rules != self.settings.hazards.rules and not rules.replace('_', '').isalnum():
            raise ConfigError(
                f'hazards.rules: {rules!r} is a path, which is taken at the start only; in flight '
                'name a rule set of config/rules'
            )

    def _swap(self, parameters: Sequence[Parameter]) -> None:
        settings = self._updated(parameters)
        if settings != self.settings:
            self._log_changes(settings)
            self.rules, self._content = self._read_rules(settings.hazards), self._read[2]
            self.settings = settings
            self._changed(settings)


def _widen(value: Any, default: Any) -> Any:
    """Return a float, or a list of floats, for integers; else the very same object."""
    if isinstance(default, float) and type(value) is int:
        return float(value)
    if isinstance(default, tuple) and isinstance(default[0], float):
        items = value if isinstance(value, str | bytes) else _to_list(value)
        if isinstance(items, list) and items and all(type(item) is int for item in items):
            return [float(item) for item in items]
    return value


def _to_list(value: Any) -> Any:
    try:
        return list(value)
    except TypeError:
        return value


def _explain(
    name: str, value: Any, descriptor: ParameterDescriptor, error: Exception
) -> str:
    for item in (*descriptor.floating_point_range, *descriptor.integer_range):
        return (
            f'parameter {name} must lie in [{item.from_value:g}, {item.to_value:g}], got {value!r}'
        )
    return f'parameter {name}: {error}'
