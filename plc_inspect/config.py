# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Settings of every stage, the single home of all defaults.

Each stage has one frozen dataclass.  ROS parameters, ``config/*.yaml``, ``--params`` files and
the table in ``docs/settings.md`` are made from these classes.  A length of 0 means "derived from
the spacing of the data"; the derived value is reported in ``run.json``.
"""

from collections.abc import Iterator, Mapping
import dataclasses
from dataclasses import dataclass, Field, field, fields
import math
from typing import Any

from plc_inspect.errors import ConfigError


def _setting(
    default: Any,
    description: str,
    *,
    unit: str = '',
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    structural: bool = False,
) -> Any:
    """Declare one setting with what a user needs to know of it."""
    return field(
        default=default,
        metadata={
            'description': description,
            'unit': unit,
            'low': low,
            'high': high,
            'choices': choices,
            'structural': structural,
        },
    )


class _Checked:
    """Type and range check shared by the settings of all stages."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Raise ConfigError unless every value has its type and lies in its range."""
        for item in fields(self):  # type: ignore[arg-type]
            _check(f'{type(self).__name__}.{item.name}', getattr(self, item.name), item)


def _check(name: str, value: Any, item: Field[Any]) -> None:
    default = item.default
    if isinstance(default, tuple):
        if not isinstance(value, tuple) or not value:
            raise ConfigError(f'{name} must be a non-empty list, got {value!r}')
        if len(value) != len(default) and isinstance(default[0], float):
            raise ConfigError(f'{name} must hold {len(default)} numbers, got {len(value)}')
        for element in value:
            _check_scalar(name, element, default[0], item)
    else:
        _check_scalar(name, value, default, item)


def _check_scalar(name: str, value: Any, default: Any, item: Field[Any]) -> None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    expected = 'a number' if isinstance(default, float) else f'of type {type(default).__name__}'
    good = number if isinstance(default, float) else type(value) is type(default)
    if not good:
        raise ConfigError(f'{name} must be {expected}, got {value!r}')
    meta = item.metadata
    if number and not (math.isfinite(value) and meta['low'] <= value <= meta['high']):
        raise ConfigError(
            f'{name} must lie in [{meta["low"]:g}, {meta["high"]:g}] {meta["unit"]}'.rstrip()
            + f', got {value!r}'
        )
    if meta['choices'] and value not in meta['choices']:
        raise ConfigError(f'{name} must be one of {", ".join(meta["choices"])}, got {value!r}')


@dataclass(frozen=True, slots=True, kw_only=True)
class InputSettings(_Checked):
    """Where scans and poses come from, and which are believed."""

    scan_topic: str = _setting(
        'velodyne_points', 'PointCloud2 topic, relative or absolute', structural=True
    )
    odometry_topic: str = _setting(
        'odometry', 'Odometry topic, relative or absolute', structural=True
    )
    lidar_xyz: tuple[float, ...] = _setting(
        (0.0, 0.0, 0.0),
        'position of the lidar in the base frame of the odometry',
        unit='m',
        low=-100.0,
        high=100.0,
    )
    lidar_rpy_deg: tuple[float, ...] = _setting(
        (0.0, 0.0, 0.0),
        'roll, pitch and yaw of the lidar in the base frame',
        unit='deg',
        low=-360.0,
        high=360.0,
    )
    min_range: float = _setting(
        1.5, 'nearer returns are the vehicle itself', unit='m', low=0.0, high=100.0
    )
    max_range: float = _setting(
        100.0, 'farther returns are not believed', unit='m', low=1.0, high=1000.0
    )
    max_pose_gap: float = _setting(
        0.25,
        'longest gap between two poses that is interpolated over',
        unit='s',
        low=0.001,
        high=10.0,
    )
    max_speed: float = _setting(
        60.0,
        'a pose that implies a faster vehicle is a jump and is not interpolated over',
        unit='m/s',
        low=0.1,
        high=1000.0,
    )
    max_wait: float = _setting(
        1.0,
        'longest wait of a scan for the odometry that brackets it',
        unit='s',
        low=0.0,
        high=60.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings(_Checked):
    """The global map: a voxel buffer of point moments."""

    voxel_size: float = _setting(
        0.1, 'edge of a map voxel', unit='m', low=0.02, high=2.0, structural=True
    )
    max_voxels: int = _setting(
        8_000_000, 'hard cap of occupied voxels', low=1000, high=200_000_000, structural=True
    )
    min_points: int = _setting(
        1, 'a voxel with fewer points is not used', low=1, high=1000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentSettings(_Checked):
    """When the pipeline runs."""

    period: float = _setting(
        1.0, 'time between two segmentations of the map', unit='s', low=0.05, high=3600.0
    )
    min_points: int = _setting(
        10, 'a cloud with fewer finite points gives an empty result', low=1, high=1_000_000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSettings(_Checked):
    """High elevation extraction."""

    num_bins: int = _setting(
        100, 'bins of the height histogram (nbin of Table 1)', low=10, high=500
    )
    beta: float = _setting(
        4.0,
        'points this far above local ground are high (beta of Table 1)',
        unit='m',
        low=1.0,
        high=50.0,
    )
    cell_size: float = _setting(
        1.0, 'cell of the grid of lowest points', unit='m', low=0.2, high=20.0
    )
    max_slope_deg: float = _setting(
        45.0, 'steepest terrain', unit='deg', low=5.0, high=80.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearitySettings(_Checked):
    """Linear likeness from the covariance of neighbourhoods (Eqs. 1 to 3)."""

    voxel_size: float = _setting(
        0.25, 'edge of the finest neighbourhood voxel', unit='m', low=0.05, high=5.0
    )
    num_scales: int = _setting(
        4, 'neighbourhood sizes, each twice the one before', low=1, high=6
    )
    max_occupied: int = _setting(
        14, 'cells of 27, of a metre, that may hold points about a wire', low=3, high=27
    )
    threshold: float = _setting(
        0.82, 'linear likeness of a wire (LN_thres of Table 1)', low=0.5, high=1.0
    )
    max_inclination_deg: float = _setting(
        20.0,
        'steepest direction of a wire against the horizontal (alpha_thres of Table 1)',
        unit='deg',
        low=0.0,
        high=60.0,
    )
    min_neighbors: int = _setting(
        5, 'points that a neighbourhood needs (the paper: more than 4)', low=3, high=1000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierSettings(_Checked):
    """Statistical outlier removal."""

    num_neighbors: int = _setting(
        8, 'neighbours whose mean distance is judged', low=1, high=100
    )
    sigma: float = _setting(
        4.0,
        'dropped beyond mean + sigma standard deviations (Filt_thres of Table 1)',
        low=0.1,
        high=20.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings(_Checked):
    """Direction votes and windows of one azimuth (regularisation, R_z)."""

    reach: float = _setting(
        8.0, 'others within this distance vote for a candidate', unit='m', low=2.0, high=50.0
    )
    min_votes: int = _setting(
        5, 'bins of 16 along its axis that must hold others', low=1, high=16
    )
    tile_size: float = _setting(
        8.0, 'plan tile that gets a window for each azimuth in it', unit='m', low=2.0, high=100.0
    )
    half_length: float = _setting(
        6.0, 'half the length of a window along the line', unit='m', low=1.0, high=100.0
    )
    max_turn_deg: float = _setting(
        5.0, 'azimuths of a tile farther apart belong to two windows', unit='deg',
        low=0.5, high=45.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusteringSettings(_Checked):
    """Two-stage clustering, across the line and then along it."""

    method: str = _setting(
        'dbscan', 'clusterer across the line', choices=('dbscan', 'hdbscan', 'rnn_dbscan'),
        structural=True,
    )
    eps: float = _setting(
        0.2, 'radius across the line (eps of Table 1)', unit='m', low=0.01, high=10.0
    )
    min_points: int = _setting(
        50, 'points of a core neighbourhood (min_pts of Table 1), at full sampling',
        low=1, high=10_000
    )
    max_thickness: float = _setting(
        0.15, 'thicker clusters are not one conductor (rms)', unit='m', low=0.01, high=2.0
    )
    max_crowding: float = _setting(
        0.5, 'share of its metres in which a conductor may have more points about it than on it',
        low=0.0, high=1.0,
    )
    max_gap: float = _setting(
        20.0, 'pieces of conductor this far apart are joined along the line', unit='m',
        low=1.0, high=200.0,
    )
    join_tolerance: float = _setting(
        0.12, 'pieces that are joined meet within this', unit='m', low=0.01, high=2.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CatenarySettings(_Checked):
    """Catenary model of each conductor in each span (Eqs. 6 and 7, MSAC)."""

    tolerance: float = _setting(
        0.0, 'largest residual of an inlier, 0: from the noise', unit='m', low=0.0, high=2.0
    )
    num_trials: int = _setting(64, 'hypotheses of MSAC', low=8, high=10_000)
    max_step: float = _setting(
        8.0, 'a conductor is followed over gaps up to this, step by step', unit='m',
        low=0.5, high=100.0,
    )
    max_bridge: float = _setting(
        120.0, 'longest gap in a span that the model bridges', unit='m', low=0.0, high=1000.0
    )
    bundle_width: float = _setting(
        0.6, 'sub-conductors of a bundle are this near', unit='m', low=0.0, high=2.0
    )
    bundle_length: float = _setting(
        80.0, 'bundles are looked for in spans from this length', unit='m', low=0.0, high=1000.0
    )
    bundle_separation: float = _setting(
        7.0, 'sub-conductors are told apart from this distance over their spread',
        low=0.0, high=100.0,
    )
    min_length: float = _setting(
        12.0, 'shortest span; half of it where it continues a line at a support', unit='m',
        low=1.0, high=1000.0,
    )
    min_points: int = _setting(12, 'fewest inliers of a span', low=4, high=100_000)
    min_coverage: float = _setting(
        0.3, 'smallest share of a span that holds points', low=0.0, high=1.0
    )
    min_significance: float = _setting(
        10.0, 'curvature of a conductor in its own standard deviations', low=0.0, high=1000.0
    )
    max_constant: float = _setting(
        6000.0, 'greatest catenary constant T0 / w', unit='m', low=100.0, high=1_000_000.0
    )
    max_sag_ratio: float = _setting(
        0.08, 'greatest sag as a share of the span', low=0.01, high=1.0
    )
    min_free_length: float = _setting(
        8.0, 'free metres, less cluttered ones: half if it sags, thrice if straight', unit='m',
        low=0.0, high=1000.0,
    )
    max_clutter: float = _setting(
        0.35, 'greatest share of a span by which cluttered metres may outnumber free ones',
        low=-1.0, high=1.0,
    )
    max_crowding: float = _setting(
        0.45, 'greatest share of a bundle or tap with points close about it',
        low=0.0, high=1.0,
    )
    max_company: float = _setting(
        0.7, 'greatest share of a tap with other things within 0.8 m', low=0.0, high=1.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportSettings(_Checked):
    """Towers and poles, where spans begin and end."""

    radius: float = _setting(
        3.0, 'attachments of one support lie within this along the line', unit='m',
        low=0.1, high=50.0,
    )
    width: float = _setting(
        30.0, 'and within this across it', unit='m', low=0.5, high=100.0
    )
    min_span: float = _setting(
        12.0, 'shortest distance between two supports', unit='m', low=2.0, high=1000.0
    )
    max_reach: float = _setting(
        40.0, 'a conductor that fades out is extended this far to its support', unit='m',
        low=1.0, high=300.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CorridorSettings(_Checked):
    """The power line corridor, PLC (Eq. 9)."""

    environment: str = _setting(
        'auto',
        'case of Eq. 9: complex where things stand higher than the line, else open',
        choices=('auto', 'complex', 'open'),
    )
    radius: float = _setting(
        0.0,
        'search radius about a conductor (r of Table 1), 0: by Eq. 9',
        unit='m',
        low=0.0,
        high=100.0,
    )
    max_radius: float = _setting(
        20.0, 'upper bound of the radius of Eq. 9', unit='m', low=0.6, high=200.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HazardSettings(_Checked):
    """Clearance rules of the plain default set, interference and abnormal sag."""

    warning_distance: float = _setting(
        4.0, 'vegetation nearer than this is a warning', unit='m', low=0.0, high=100.0
    )
    critical_distance: float = _setting(
        2.0, 'vegetation nearer than this is critical', unit='m', low=0.0, high=100.0
    )
    ground_distance: float = _setting(
        5.0, 'least height of a conductor above ground', unit='m', low=0.0, high=100.0
    )
    crossing_distance: float = _setting(
        2.0, 'least distance between crossing lines, 0: not looked at', unit='m', low=0.0,
        high=100.0,
    )
    fall_distance: float = _setting(
        0.0, 'least distance of a falling tree from a conductor, 0: not looked at', unit='m',
        low=0.0, high=100.0,
    )
    rules: str = _setting(
        'plain', 'rule set: plain for the distances above, a name in config/rules or a file'
    )
    voltage: float = _setting(
        0.0, 'nominal voltage that rule sets ask for, 0: unknown', unit='kV', low=0.0, high=2000.0
    )
    elevation: float = _setting(
        -1000.0, 'elevation that rule sets ask for, below -500: unknown', unit='m', low=-1000.0,
        high=9000.0,
    )
    growth: float = _setting(
        0.0, 'growth of vegetation towards the conductors a year, 0: unknown', unit='m', low=0.0,
        high=10.0,
    )
    interference_ratio: float = _setting(
        0.5,
        'conductors nearer in the span than this share of their distance at the supports',
        low=0.0,
        high=1.0,
    )
    sag_deviation: float = _setting(
        0.25, 'sag beyond its peers by this share is abnormal', low=0.01, high=10.0
    )
    min_points: int = _setting(3, 'fewest points of a hazard', low=1, high=10_000)
    group_distance: float = _setting(
        2.0, 'offending points within this distance are one hazard', unit='m', low=0.1, high=50.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings(_Checked):
    """Where the node writes; the commands are told by their arguments."""

    directory: str = _setting(
        '',
        'results folder of plc_node, replaced at every save; empty: a new one below ~/.ros',
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings(_Checked):
    """What the node streams to ground stations over a thin link."""

    max_kbps: float = _setting(
        256.0,
        'rate that summary and thinned corridor keep to, for each monitor; 0: no corridor',
        unit='kbit/s',
        low=0.0,
        high=100_000.0,
    )
    voxel_size: float = _setting(
        0.5, 'edge of a cell of the thinned corridor', unit='m', low=0.1, high=10.0,
        structural=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """All settings; the attribute names are the sections of files and parameters."""

    input: InputSettings = field(default_factory=InputSettings)
    map: MapSettings = field(default_factory=MapSettings)
    segment: SegmentSettings = field(default_factory=SegmentSettings)
    height: HeightSettings = field(default_factory=HeightSettings)
    linearity: LinearitySettings = field(default_factory=LinearitySettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)
    clustering: ClusteringSettings = field(default_factory=ClusteringSettings)
    catenary: CatenarySettings = field(default_factory=CatenarySettings)
    supports: SupportSettings = field(default_factory=SupportSettings)
    corridor: CorridorSettings = field(default_factory=CorridorSettings)
    hazards: HazardSettings = field(default_factory=HazardSettings)
    output: OutputSettings = field(default_factory=OutputSettings)
    stream: StreamSettings = field(default_factory=StreamSettings)


def describe() -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """
    Yield name, default and metadata of every setting, in order.

    Names are dotted, as in ``height.beta``.  The metadata holds ``description``, ``unit``,
    ``low``, ``high``, ``choices`` and ``structural`` (cannot be changed while running).
    """
    for section in fields(Settings):
        for item in fields(type(getattr(Settings(), section.name))):
            yield f'{section.name}.{item.name}', item.default, item.metadata


def to_mapping(settings: Settings) -> dict[str, dict[str, Any]]:
    """Return the settings as section -> name -> plain value; tuples become lists."""
    return {
        section: {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
        }
        for section, values in dataclasses.asdict(settings).items()
    }


def update(settings: Settings, mapping: Mapping[str, Any]) -> Settings:
    """
    Return ``settings`` with the values of a nested or dotted mapping put in.

    Integers are taken where a float is meant and lists where a tuple is meant.

    Raises
    ------
    ConfigError
        A section or name is unknown, or a value has the wrong type or range.

    """
    changes: dict[str, dict[str, Any]] = {}
    for key, value in _flatten(mapping):
        section, _, name = key.partition('.')
        current = getattr(settings, section, None) if section in _sections() else None
        if current is None or name not in {item.name for item in fields(current)}:
            raise ConfigError(f'unknown setting {key!r}')
        default = getattr(current, name)
        if isinstance(value, list):
            value = tuple(value)
        if isinstance(default, float) and type(value) is int:
            value = float(value)
        if isinstance(default, tuple) and isinstance(value, tuple):
            value = tuple(float(v) if type(v) is int else v for v in value)
        changes.setdefault(section, {})[name] = value
    return dataclasses.replace(
        settings,
        **{
            section: dataclasses.replace(getattr(settings, section), **values)
            for section, values in changes.items()
        },
    )


def _sections() -> set[str]:
    return {item.name for item in fields(Settings)}


def _flatten(mapping: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
