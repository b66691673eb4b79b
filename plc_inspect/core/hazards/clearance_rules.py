# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Clearance rules as data: which distance is required, by whom, and how severe a breach is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
import math
from typing import Any

from plc_inspect.config import HazardSettings
from plc_inspect.errors import ConfigError
from plc_inspect.results import Severity

UNKNOWN = 'unknown'
"""Name of a voltage that is not given."""
PLAIN = 'plain'
"""Name of the rule set that the settings hold."""
PLAIN_EDITION = 'plc_inspect 0.1'
"""Its edition."""
FEATURES = ('vegetation', 'fall_in', 'ground', 'building', 'line', 'water', 'road')
"""What a limit may refer to."""
UNSEEN = {'water': 'water', 'road': 'roads'}
"""Features that coordinates alone cannot tell; their limits are reported as not applied."""
MEASURES = ('distance', 'horizontal', 'vertical')
PLACES = ('any', 'under', 'beside')
KNOWN_PARTS = {
    'fall_in': {('distance', 'any')}, 'line': {('distance', 'any')},
    'ground': {('distance', 'any'), ('vertical', 'any')},
}
"""How limits of features are measured and where, of those that are not any way."""
FOOT = 0.3048
"""The international foot [m].  Source: definition of 1959."""
LEAST_ELEVATION = -500.0
"""Elevations below this mean that it is unknown [m].  Source: judgement; not measured."""
HIGHEST = 25.0
"""
Height of a conductor above what it is near to horizontally, up to which that is looked for [m].
Source: derived: rules that are measured horizontally hold up to 55 kV, whose lines are lower.
"""
SAME_VOLTAGE = 1e-6
"""
Relative difference up to which nominal voltages are equal.
Source: numerical: rounding of decimal figures.
"""
GREATEST = 1e9
"""Greatest number of a rule file.  Source: numerical: of any size, ints are no floats."""
_UNITS = {'m': 1.0, 'ft': FOOT}
"""Units of rule files [m].  Source: derived: see FOOT."""
_SET_KEYS = {'name', 'title', 'edition', 'source', 'note', 'unit', 'elevations', 'tiers', 'limits'}
_LIMIT_KEYS = {'feature', 'kv', 'distance', 'measure', 'where', 'tiers', 'source', 'note'}


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """One distance that a rule set requires."""

    feature: str
    """One of FEATURES."""
    distance: float
    """The distance that is required [m]."""
    tiers: tuple[tuple[Severity, float], ...]
    """Severity and the distance from which on it holds [m], most severe and nearest first."""
    measure: str = 'distance'
    """'distance' in space, or its 'horizontal' or 'vertical' part."""
    where: str = 'any'
    """'under' or 'beside' the conductor, whichever part of the distance is greater, or 'any'."""
    source: str = ''
    note: str = ''
    title: str = ''
    """Of the rule set that it was taken from, where that is another than its own."""
    edition: str = ''
    """Of that rule set."""

    @property
    def reach(self) -> float:
        """Greatest value of the measure at which anything is reported [m]."""
        return self.tiers[-1][1]

    @property
    def radius(self) -> float:
        """Greatest distance in space at which anything is reported [m]."""
        return math.hypot(self.reach, HIGHEST) if self.measure == 'horizontal' else self.reach

    def judge(self, value: float) -> Severity | None:
        """Return how severe a measured value [m] is, None where the limit is kept."""
        return next((severity for severity, distance in self.tiers if value < distance), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleSet:
    """The limits that apply to one line, and who requires them."""

    name: str
    title: str
    edition: str
    source: str
    limits: tuple[Limit, ...]
    voltage: str = UNKNOWN
    """Voltage for which the limits were chosen, as '110 kV'; 'unknown' is never guessed."""
    not_applied: tuple[str, ...] = ()
    """Limits that were left out, and why."""
    uncovered: tuple[str, ...] = ()
    """Features that it has no limit for at this voltage, for which the plain distances hold."""

    @property
    def gaps(self) -> str:
        """What it does not cover, in words; empty where it covers all."""
        if not self.uncovered:
            return ''
        at = '' if self.voltage == UNKNOWN else f' at {self.voltage}'
        return (
            f'not covered by {self.name}{at}: {", ".join(self.uncovered)}'
            ' (the plain distances hold instead)'
        )

    def find(self, feature: str) -> tuple[Limit, ...]:
        """Return the limits of one feature."""
        return tuple(limit for limit in self.limits if limit.feature == feature)

    def reach(self, *features: str) -> float:
        """Return the greatest distance in space at which any of some features is reported [m]."""
        return max((item.radius for item in self.limits if item.feature in features), default=0.0)


def plain_rules(settings: HazardSettings) -> RuleSet:
    """
    Return the rule set that the settings hold, which claims no authority.

    Vegetation and structures are critical, or a warning, below the two distances of the settings;
    ground, other lines and falling trees are warnings.  A distance of 0 leaves the rule out.

    Raises
    ------
    ConfigError
        The critical distance is greater than the warning distance.

    """
    critical, warning = settings.critical_distance, settings.warning_distance
    if critical > warning:
        raise ConfigError(
            f'hazards.critical_distance {critical:g} m is greater than'
            f' hazards.warning_distance {warning:g} m'
        )
    near = ((Severity.CRITICAL, critical), (Severity.WARNING, warning))
    limits = [
        Limit(feature=feature, distance=warning, tiers=near)
        for feature in ('vegetation', 'building') if warning > 0
    ]
    limits += [
        Limit(feature=feature, distance=distance, measure=measure,
              tiers=((Severity.WARNING, distance),))
        for feature, distance, measure in (
            ('ground', settings.ground_distance, 'vertical'),
            ('line', settings.crossing_distance, 'distance'),
            ('fall_in', settings.fall_distance, 'distance'),
        ) if distance > 0
    ]
    return RuleSet(
        name=PLAIN,
        title='plain distances',
        edition=PLAIN_EDITION,
        source='settings of section hazards; no authority',
        limits=tuple(limits),
        voltage=_name_voltage(settings.voltage),
    )


def parse_rules(content: Mapping[str, Any], settings: HazardSettings) -> RuleSet:
    """
    Read a rule set and choose the limits that apply to the line.

    Parameters
    ----------
    content : mapping
        As ``config/rules/*.yaml`` hold it; ``docs/hazards.md`` describes the keys.
    settings : HazardSettings
        Voltage [kV], 0 unknown, and elevation above sea level [m], below LEAST_ELEVATION unknown.

    Returns
    -------
    RuleSet
        Distances in metres.  ``not_applied`` names limits that need an unknown voltage, and those
        of features that coordinates cannot tell; of features that are left without a limit,
        ``uncovered``, the plain distances of the settings hold, and are labelled so.

    Raises
    ------
    ConfigError
        A key is missing, unknown or of a wrong kind; two limits, or the plain distances of the
        settings, contradict one another; the elevation is needed and unknown or beyond the table;
        or no limit is left, whatever the voltage, or as it is unknown.

    """
    if not isinstance(content, Mapping):
        raise ConfigError(f'a rule set is a mapping, got {type(content).__name__}')
    name = content.get('name')
    if not isinstance(name, str) or not name:
        raise ConfigError('a rule set has no name')
    _check_keys(content, _SET_KEYS, f'rule set {name}')
    for key in ('title', 'edition', 'source', 'limits'):
        if not content.get(key):
            raise ConfigError(f'rule set {name} has no {key}')
    unit = _UNITS.get(str(content.get('unit', 'm')))
    if unit is None:
        raise ConfigError(f'rule set {name}: unit must be m or ft, got {content["unit"]!r}')
    if not isinstance(content['limits'], list):
        raise ConfigError(f'rule set {name}: limits must be a list')
    applied: list[Limit] = []
    left_out: list[str] = []
    voltages: list[str] = []
    elsewhere: list[str] = []
    for number, row in enumerate(content['limits']):
        where = f'rule set {name}, limit {number + 1}'
        if not isinstance(row, Mapping):
            raise ConfigError(f'{where} is no mapping')
        _check_keys(row, _LIMIT_KEYS, where)
        limit = _read_limit(row, content, unit, settings, where)
        kv = row.get('kv')
        title = f'{limit.feature} {limit.distance:.2f} m'
        if limit.feature in UNSEEN:
            left_out.append(f'{title}: {UNSEEN[limit.feature]} cannot be told from points')
        elif kv is None:
            applied.append(limit)
        else:
            holds = _holds(kv, settings.voltage, where)
            voltages.append(_name_range(kv))
            if settings.voltage == 0.0:
                left_out.append(f'{title} at {_name_range(kv)}: the voltage is unknown')
            elif holds:
                applied.append(limit)
            else:
                elsewhere.append(limit.feature)
    _check_contradictions(applied, name)
    if not applied and not (voltages and settings.voltage):
        raise ConfigError(
            f'rule set {name} has no limit for a line of unknown voltage; it has'
            f' {", ".join(dict.fromkeys(voltages))} (give hazards.voltage)'
            if voltages else f'rule set {name} has no limit that points can be held against'
        )
    left_out += [
        f'{feature}: no limit for {_name_voltage(settings.voltage)}'
        for feature in dict.fromkeys(elsewhere)
        if feature not in {limit.feature for limit in applied}
    ]
    plain = _choose_plain({limit.feature for limit in applied}, name, settings)
    return RuleSet(
        name=name,
        title=str(content['title']),
        edition=str(content['edition']),
        source=str(content['source']),
        limits=(*applied, *plain),
        voltage=_name_voltage(settings.voltage),
        not_applied=tuple(left_out),
        uncovered=tuple(dict.fromkeys(limit.feature for limit in plain)),
    )


def _choose_plain(covered: set[str], name: str, settings: HazardSettings) -> list[Limit]:
    """Return the plain limits for what a rule set does not cover, labelled as such."""
    plain = plain_rules(settings)
    return [
        replace(
            limit, title=plain.title, edition=plain.edition, source=plain.source,
            note=f'{name} has no limit for this at {plain.voltage} voltage'
            if plain.voltage == UNKNOWN else f'{name} has no limit for this at {plain.voltage}',
        )
        for limit in plain.limits if limit.feature not in covered
    ]


def describe_rules(rules: RuleSet) -> dict[str, Any]:
    """Return a rule set as plain values, for reports; distances in metres."""
    return {
        'rules': rules.title,
        'edition': rules.edition,
        'source': rules.source,
        'voltage': rules.voltage,
        'limits': [
            ' '.join(
                [f'{item.feature} {item.distance:.2f} m']
                + ([item.where] if item.where != 'any' else [])
                + ([item.measure] if item.measure != 'distance' else [])
                + [f'({severity.name.lower()} {distance:.2f} m)'
                   for severity, distance in item.tiers]
                + ([f'by {item.title}'] if item.title else [])
            )
            for item in rules.limits
        ],
        'not_applied': list(rules.not_applied),
        'not_covered': rules.gaps,
    }


def _read_limit(
    row: Mapping[str, Any], content: Mapping[str, Any], unit: float, settings: HazardSettings,
    where: str,
) -> Limit:
    feature, measure = row.get('feature'), row.get('measure', 'distance')
    place = row.get('where', 'any')
    for key, value, known in (
        ('feature', feature, FEATURES), ('measure', measure, MEASURES), ('where', place, PLACES),
    ):
        if value not in known:
            raise ConfigError(f'{where}: {key} must be one of {", ".join(known)}, got {value!r}')
    if (measure, place) not in KNOWN_PARTS.get(str(feature), {(measure, place)}):
        raise ConfigError(
            f'{where}: a limit of {feature} cannot be {measure} and {place}: leave out'
            ' measure and where'
        )
    distance = unit * _read_distance(row.get('distance'), content, settings, where)
    tiers = row.get('tiers', content.get('tiers', {'critical': 1.0}))
    if not isinstance(tiers, Mapping) or not tiers:
        raise ConfigError(f'{where}: tiers must map a severity to a factor')
    steps = []
    for key, factor in tiers.items():
        if str(key).upper() not in Severity.__members__:
            names = ', '.join(item.name.lower() for item in Severity)
            raise ConfigError(f'{where}: tier must be one of {names}, got {key!r}')
        steps.append((Severity[str(key).upper()], distance * _number(factor, f'{where}: {key}')))
    steps.sort(key=lambda step: -step[0])
    if any(nearer[1] > farther[1] for nearer, farther in pairwise(steps)):
        raise ConfigError(f'{where}: a more severe tier must not reach farther')
    source = str(row.get('source', content['source']))
    note = ' '.join(str(row.get('note', content.get('note', ''))).split())
    return Limit(feature=str(feature), distance=distance, tiers=tuple(steps), measure=measure,
                 where=place, source=source, note=note)


def _read_distance(
    value: Any, content: Mapping[str, Any], settings: HazardSettings, where: str
) -> float:
    """Return one distance, or that of the elevation's column, in the unit of the rule set."""
    if not isinstance(value, list):
        return _number(value, f'{where}: distance')
    columns = content.get('elevations')
    if not isinstance(columns, Sequence) or len(columns) != len(value):
        raise ConfigError(f'{where}: {len(value)} distances need as many elevations')
    if settings.elevation < LEAST_ELEVATION:
        raise ConfigError(
            f'{where} depends on the elevation above sea level: give hazards.elevation'
        )
    scale = _UNITS[content.get('unit', 'm')]
    columns = [_number(limit, f'{where}: elevation') for limit in columns]
    if columns != sorted(columns):
        raise ConfigError(f'{where}: elevations must ascend')
    for limit, distance in zip(columns, value, strict=True):
        if settings.elevation <= limit * scale:
            return _number(distance, f'{where}: distance')
    raise ConfigError(
        f'{where}: no distance for {settings.elevation:g} m above sea level, only up to'
        f' {columns[-1] * scale:.0f} m'
    )


def _holds(kv: Any, voltage: float, where: str) -> bool:
    """Tell whether a limit for one nominal voltage, or for a range [low, high), applies."""
    if isinstance(kv, list):
        if len(kv) != 2:
            raise ConfigError(f'{where}: kv must be one voltage or [low, high]')
        low, high = (_number(value, f'{where}: kv', finite=False) for value in kv)
        if low >= high:
            raise ConfigError(f'{where}: kv from {low:g} to {high:g}')
        return low <= voltage < high
    return math.isclose(_number(kv, f'{where}: kv'), voltage, rel_tol=SAME_VOLTAGE)


def _check_contradictions(limits: Sequence[Limit], name: str) -> None:
    seen: dict[tuple[str, str, str], float] = {}
    for item in limits:
        key = (item.feature, item.where, item.measure)
        if seen.setdefault(key, item.distance) != item.distance:
            raise ConfigError(
                f'rule set {name} contradicts itself: {item.feature} {seen[key]:.2f} m and'
                f' {item.distance:.2f} m'
            )


def _check_keys(row: Mapping[str, Any], known: set[str], where: str) -> None:
    unknown = sorted(str(key) for key in set(row) - known)
    if unknown:
        raise ConfigError(f'{where}: unknown key {unknown[0]!r}')


def _number(value: Any, where: str, *, finite: bool = True) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and (
        0.0 <= value <= GREATEST or (value == math.inf and not finite)
    ):
        return float(value)
    raise ConfigError(f'{where} must be a number from 0, got {value!r}')


def _name_voltage(voltage: float) -> str:
    return f'{voltage:g} kV' if voltage else UNKNOWN


def _name_range(kv: Any) -> str:
    return f'{kv[0]:g} to {kv[1]:g} kV' if isinstance(kv, list) and len(kv) == 2 else f'{kv} kV'
