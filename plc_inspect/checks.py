# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A figure against its limit: why a stage kept or dropped something."""

from dataclasses import dataclass
import math


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One figure of a point or curve, and the limit it was compared with."""

    name: str = ''
    """Name for the user; empty if the setting names it."""
    value: float
    limit: float = math.nan
    """NaN if the value is only reported."""
    is_least: bool = True
    """The limit is a least value, else a greatest value."""
    setting: str = ''
    """Dotted name of the setting that is the limit; empty for a constant."""
    scale: float = 1.0
    """The limit is the setting times this."""
    unit: str = ''
    """Unit of the setting."""
    objection: str = ''
    """Text for the user if the limit is not kept."""

    @property
    def kept(self) -> bool:
        """Whether the value is within the limit."""
        return not (self.value < self.limit if self.is_least else self.value > self.limit)

    @property
    def scaled(self) -> tuple[float, float]:
        """Value and limit in the unit of the setting; NaN where the scale is not positive."""
        scale = self.scale if self.scale > 0.0 else math.nan
        return self.value / scale, self.limit / scale
