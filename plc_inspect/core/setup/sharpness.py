# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How sharp the map is: whether what was seen at one moment lies where it was seen at another.

With the right set-up planes and lines of two looks are as near as the noise of the sensor lets
them; what a wrong mount, wrong frames or wrong times do grows with the way flown between them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from plc_inspect.core.setup.looks import (
    FAR,
    LONG,
    LookWindow,
    measure_spread,
    Scale,
    SCALES,
    SHORT,
    Spread,
)
from plc_inspect.results import Float64

LEAST_PLANES, LEAST_LINES = 30, 5
"""Cells from which a figure is believed.  Source: judgement; not measured."""
UNSURE = 2.0
"""So many standard deviations of the median must be over the limit.  Source: derived: 98 %."""
HELD = 1.0
"""Blur over its limit from which hazards are held back.  Source: derived: limits are set so."""
GROSS_PLANES, GROSS_LINES = 0.15, 0.17
"""
Distances between looks of the short scale from which that one counts [m].  Lines of it do only
where planes are not sharp: arcs of the scan on the ground, which are no lines, reach 0.35.
Source: measured: bench/studies/sharpness.py: bundles, which are no planes, reach 0.10 with the
right set-up; bench/flights/drawn_flights.py, seeds 7001 and 7028: arcs.
"""

HOPELESS = 3.0
"""
Blur over its limit from which lines are not looked for in the whole map any more.
Source: measured: bench/studies/sharpness.py: no right line was found from 4 on; bench/faults.py:
quaternions written in another order gave 3.2, and 128 lines that are none.
"""
UNKNOWN = 'sharpness unknown: too few planes and lines were seen twice'
ON_TRUST = f'{UNKNOWN}; hazards are as right as mount, frames and time: check them'


@dataclass(frozen=True, slots=True, kw_only=True)
class Sharpness:
    """How sharp a map is."""

    blur: float = 0.0
    """Distance of looks at one thing over its limit; more than 1 is not sharp."""
    distance: float = 0.0
    """That distance [m]."""
    noise: float = 0.0
    """Thickness of a plane in one look [m]."""
    num_cells: int = 0
    """Cells that were compared."""
    doubt: str = ''
    """What else is wrong with the map, '' if nothing is known of."""
    useless: bool = False
    """Whether lines cannot be found in it."""
    remark: str = ''
    """What else may be wrong with it, which holds nothing back."""

    @property
    def known(self) -> bool:
        """Whether enough was seen to tell."""
        return self.num_cells > 0

    @property
    def poor(self) -> bool:
        """Whether hazards are held back."""
        return bool(self.doubt) or (self.known and self.blur > HELD)

    @property
    def hopeless(self) -> bool:
        """Whether lines are not looked for either."""
        return self.useless or (self.known and self.blur > HOPELESS)

    @property
    def figure(self) -> float:
        """Sharpness from 0 to 1; 0.5 is the limit."""
        return 1.0 / (1.0 + self.blur)

    def record(self) -> dict[str, float | bool | int]:
        """Return it JSON-serialisable."""
        return {
            'known': self.known, 'figure': round(self.figure, 3), 'poor': self.poor,
            'distance': round(self.distance, 4), 'noise': round(self.noise, 4),
            'num_cells': self.num_cells,
        }

    def describe(self) -> str:
        """Return it in one line."""
        if self.doubt:
            return self.doubt
        if not self.known:
            return UNKNOWN
        text = (
            f'sharpness {self.figure:.2f}: things seen twice lie {self.distance:.3f} m apart, '
            f'noise {self.noise:.3f} m'
        )
        if not self.poor:
            return text
        held = 'nothing is looked for in it' if self.hopeless else 'hazards are held back'
        return f'map is not sharp: check mount, frames, time ({text}); {held}'


@dataclass(slots=True)
class SharpnessBook:
    """
    What was measured so far.

    Parameters
    ----------
    num_windows : int or None
        Windows that are remembered; None: all.

    """

    num_windows: int | None = None
    _spreads: deque[Spread] = field(init=False)

    def __post_init__(self) -> None:
        """Begin with nothing."""
        self._spreads = deque(maxlen=self.num_windows)

    def clear(self) -> None:
        """Forget what was measured."""
        self._spreads.clear()

    def remember(self) -> tuple[Spread, ...]:
        """Return what was measured, oldest first; what is in it never changes."""
        return tuple(self._spreads)

    def restore(self, spreads: Sequence[Spread]) -> None:
        """Go on from what another book measured."""
        self.clear()
        self._spreads.extend(spreads)

    def add(self, windows: Sequence[LookWindow]) -> None:
        """Measure some windows."""
        self._spreads.extend(measure_spread(window) for window in windows)

    def judge(self) -> Sharpness:
        """
        Return how sharp the map is, by the worst of planes and lines.

        Of few cells the median is great by chance: up to the limit the first that are enough
        count as they are, others as far as they surely lie apart.
        """
        found = Sharpness()
        near, far = (self._measure(scale, 'planes', LEAST_PLANES) for scale in (LONG, FAR))
        planes, limit = (near, LONG.limit) if near is not None else (far, FAR.limit)
        sharp = planes is not None and planes[0].distance <= limit
        # what the long one shows may not be known yet
        unsure = not any(SCALES[item.scale] is LONG for item in self._spreads)
        for scale, kind, least, gross in (
            (LONG, 'planes', LEAST_PLANES, 0.0), (LONG, 'lines', LEAST_LINES, 0.0),
            (SHORT, 'planes', LEAST_PLANES, GROSS_PLANES),
            (SHORT, 'lines', LEAST_LINES, GROSS_LINES), (FAR, 'planes', LEAST_PLANES, 0.0),
        ):
            measured = self._measure(scale, kind, least)
            if measured is None:
                continue
            own, surely = measured
            if own.distance < gross:
                continue
            arcs = kind == 'lines' and scale is SHORT and sharp
            if arcs or (scale is SHORT and unsure) or (scale is FAR and found.known):
                continue
            own = surely if found.known else own
            if own.blur >= found.blur:
                found = own
        return found

    def _measure(
        self, scale: Scale, kind: str, least: int
    ) -> tuple[Sharpness, Sharpness] | None:
        """Return what one scale says by planes or lines, and surely; None: there are too few."""
        own = [item for item in self._spreads if SCALES[item.scale] is scale]
        values = _gather([item.planes if kind == 'planes' else item.lines for item in own])
        if len(values) < least:
            return None
        noise = _gather([item.noise for item in own])
        low = max(0.0, 0.5 - 0.5 * UNSURE / np.sqrt(len(values)))
        distance, sure = (float(np.sqrt(item)) for item in np.quantile(values, (0.5, low)))
        # what grows with the way flown is that much more over a long window
        share = LONG.window_ns / scale.window_ns / scale.limit
        found = Sharpness(
            blur=share * distance, distance=distance, num_cells=len(values),
            noise=float(np.sqrt(np.median(noise))) if len(noise) else 0.0,
        )
        if share * sure > HELD:
            return found, found
        return (
            replace(found, blur=min(found.blur, HELD)),
            replace(found, blur=share * sure, distance=sure),
        )


def _gather(parts: Sequence[Float64]) -> Float64:
    return np.concatenate([np.zeros(0), *parts])
