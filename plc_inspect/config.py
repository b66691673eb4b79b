# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Settings of every stage, the single home of all defaults.

Each stage has one frozen dataclass.  ROS parameters, ``config/*.yaml``, ``--params`` files and
the table in ``docs/settings.md`` are made from these classes.  A length of 0 means "derived from
the spacing of the data"; the derived value is reported in ``run.json``.
"""

from dataclasses import dataclass, field

from plc_inspect.node_config import (
    OutputSettings,
    ProximitySettings,
    SecuritySettings,
    StreamSettings,
)
from plc_inspect.setting import Checked, setting

MOST_VOXELS = 200_000_000
"""Greatest size of a map in voxels of some 45 bytes, allocated as needed.  Source: judgement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InputSettings(Checked):
    """Sources of scans and poses, and limits of plausible ones."""

    scan_topic: str = setting(
        'velodyne_points', 'PointCloud2 topic, relative or absolute', structural=True
    )
    odometry_topic: str = setting(
        'odometry', 'topic of the poses, relative or absolute', structural=True
    )
    odometry_type: str = setting(
        'auto', 'type of that topic; auto: the one it has; tf: poses from /tf, no topic',
        choices=('auto', 'Odometry', 'PoseStamped', 'PoseWithCovarianceStamped', 'tf'),
        structural=True,
    )
    map_frame: str = setting(
        'odom', 'frame of the map, where poses come from tf', structural=True
    )
    base_frame: str = setting(
        'base_link', 'frame that the poses are of, where their messages do not tell',
        structural=True,
    )
    use_tf: bool = setting(
        True, 'take the mount of the lidar from /tf_static where lidar_xyz and lidar_rpy_deg are 0'
    )
    lidar_xyz: tuple[float, ...] = setting(
        (0.0, 0.0, 0.0), 'position of the lidar in the base frame of the odometry', unit='m',
        low=-100.0, high=100.0,
    )
    lidar_rpy_deg: tuple[float, ...] = setting(
        (0.0, 0.0, 0.0), 'roll, pitch and yaw of the lidar in the base frame', unit='deg',
        low=-360.0, high=360.0,
    )
    min_range: float = setting(
        1.5, 'nearer returns are the vehicle itself', unit='m', low=0.0, high=100.0
    )
    max_range: float = setting(
        100.0, 'farther returns are not believed', unit='m', low=1.0, high=1000.0
    )
    max_pose_gap: float = setting(
        0.25, 'longest gap between two poses that is interpolated over', unit='s', low=0.001,
        high=10.0,
    )
    max_speed: float = setting(
        60.0, 'a pose that implies a faster vehicle is a jump and is not interpolated over',
        unit='m/s', low=0.1, high=1000.0,
    )
    max_wait: float = setting(
        1.0, 'longest wait of a scan for the odometry that brackets it', unit='s', low=0.0,
        high=60.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings(Checked):
    """The global map: a voxel buffer of point moments."""

    voxel_size: float = setting(
        0.1, 'edge of a map voxel', unit='m', low=0.02, high=2.0, structural=True
    )
    max_voxels: int = setting(
        8_000_000, 'hard cap of occupied voxels', low=1000, high=MOST_VOXELS, structural=True
    )
    min_points: int = setting(
        1, 'a voxel with fewer points is not used', low=1, high=1000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentSettings(Checked):
    """When the pipeline runs."""

    period: float = setting(
        1.0, 'time between two segmentations of the map', unit='s', low=0.05, high=3600.0
    )
    niceness: int = setting(
        0, 'niceness of the process that segments the map in flight, beside that of the node; it '
        'can be raised in flight, not lowered', low=0, high=19,
    )
    min_points: int = setting(
        10, 'a cloud with fewer finite points gives an empty result', low=1, high=1_000_000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSettings(Checked):
    """High elevation extraction."""

    num_bins: int = setting(
        100, 'bins of the height histogram (nbin of Table 1)', low=10, high=500
    )
    beta: float = setting(
        4.0, 'points this far above local ground are high (beta of Table 1)', unit='m', low=1.0,
        high=50.0,
    )
    cell_size: float = setting(
        1.0, 'cell of the grid of lowest points', unit='m', low=0.2, high=20.0
    )
    max_slope_deg: float = setting(
        45.0, 'steepest terrain', unit='deg', low=5.0, high=80.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearitySettings(Checked):
    """Linear likeness from the covariance of neighbourhoods (Eqs. 1 to 3)."""

    voxel_size: float = setting(
        0.25, 'edge of the finest neighbourhood voxel', unit='m', low=0.05, high=5.0
    )
    num_scales: int = setting(
        4, 'neighbourhood sizes, each twice the one before', low=1, high=6
    )
    max_occupied: int = setting(
        14, 'cells of 27, of a metre, that may hold points about a wire', low=3, high=27
    )
    threshold: float = setting(
        0.82, 'linear likeness of a wire (LN_thres of Table 1)', low=0.5, high=1.0
    )
    max_inclination_deg: float = setting(
        20.0, 'steepest direction of a wire against the horizontal (alpha_thres of Table 1)',
        unit='deg', low=0.0, high=60.0,
    )
    min_neighbors: int = setting(
        5, 'points that a neighbourhood needs (the paper: more than 4)', low=3, high=1000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierSettings(Checked):
    """Statistical outlier removal."""

    num_neighbors: int = setting(
        8, 'neighbours whose mean distance is judged', low=1, high=100
    )
    sigma: float = setting(
        4.0, 'dropped beyond mean + sigma standard deviations (Filt_thres of Table 1)', low=0.1,
        high=20.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings(Checked):
    """Direction votes and windows of one azimuth (regularisation, R_z)."""

    reach: float = setting(
        8.0, 'others within this distance vote for a candidate', unit='m', low=2.0, high=50.0
    )
    min_votes: int = setting(
        5, 'bins of 16 along its axis that must hold others', low=1, high=16
    )
    tile_size: float = setting(
        8.0, 'plan tile that gets a window for each azimuth in it', unit='m', low=2.0, high=100.0
    )
    half_length: float = setting(
        6.0, 'half the length of a window along the line', unit='m', low=1.0, high=100.0
    )
    max_turn_deg: float = setting(
        5.0, 'azimuths of a tile farther apart belong to two windows', unit='deg',
        low=0.5, high=45.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusteringSettings(Checked):
    """Two-stage clustering, across the line and then along it."""

    method: str = setting(
        'dbscan', 'clusterer across the line', choices=('dbscan', 'hdbscan', 'rnn_dbscan'),
        structural=True,
    )
    eps: float = setting(
        0.2, 'radius across the line (eps of Table 1)', unit='m', low=0.01, high=10.0
    )
    min_points: int = setting(
        50, 'points of a core neighbourhood (min_pts of Table 1), at full sampling',
        low=1, high=10_000
    )
    max_thickness: float = setting(
        0.15, 'thicker clusters are not one conductor (rms)', unit='m', low=0.01, high=2.0
    )
    max_crowding: float = setting(
        0.5, 'share of its metres in which a conductor may have more points about it than on it',
        low=0.0, high=1.0,
    )
    max_gap: float = setting(
        20.0, 'pieces of conductor this far apart are joined along the line', unit='m',
        low=1.0, high=200.0,
    )
    join_tolerance: float = setting(
        0.12, 'pieces that are joined meet within this', unit='m', low=0.01, high=2.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CatenarySettings(Checked):
    """Catenary model of each conductor in each span (Eqs. 6 and 7, MSAC)."""

    tolerance: float = setting(
        0.0, 'largest residual of an inlier, 0: from the noise', unit='m', low=0.0, high=2.0
    )
    num_trials: int = setting(64, 'hypotheses of MSAC', low=8, high=10_000)
    max_step: float = setting(
        8.0, 'a conductor is followed over gaps up to this, step by step', unit='m',
        low=0.5, high=100.0,
    )
    max_bridge: float = setting(
        120.0, 'longest gap in a span that the model bridges', unit='m', low=0.0, high=1000.0
    )
    bundle_width: float = setting(
        0.6, 'sub-conductors of a bundle are this near', unit='m', low=0.0, high=2.0
    )
    bundle_length: float = setting(
        80.0, 'bundles are looked for in spans from this length', unit='m', low=0.0, high=1000.0
    )
    bundle_separation: float = setting(
        7.0, 'sub-conductors are told apart from this distance over their spread',
        low=0.0, high=100.0,
    )
    min_length: float = setting(
        4.0, 'shortest piece of a conductor', unit='m', low=1.0, high=1000.0
    )
    min_points: int = setting(12, 'fewest inliers of a span', low=4, high=100_000)
    min_coverage: float = setting(
        0.3, 'smallest share of a span that holds points', low=0.0, high=1.0
    )
    min_significance: float = setting(
        10.0, 'curvature that is proven, in its own standard deviations', low=0.1, high=1000.0
    )
    max_constant: float = setting(
        6000.0, 'greatest catenary constant T0 / w', unit='m', low=100.0, high=1_000_000.0
    )
    max_sag_ratio: float = setting(
        0.08, 'greatest sag as a share of the span', low=0.01, high=1.0
    )
    min_evidence: float = setting(
        12.0, 'metres free in the air, and 8 for a proven curvature or a conductor beside',
        unit='m', low=0.0, high=1000.0,
    )
    max_clutter: float = setting(
        0.35, 'greatest share of a span by which cluttered metres may outnumber free ones',
        low=-1.0, high=1.0,
    )
    max_crowding: float = setting(
        0.45, 'greatest share of a bundle or tap with points close about it',
        low=0.0, high=1.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportSettings(Checked):
    """Towers and poles, where spans begin and end."""

    radius: float = setting(
        3.0, 'attachments of one support lie within this along the line', unit='m',
        low=0.1, high=50.0,
    )
    width: float = setting(
        30.0, 'and within this across it', unit='m', low=0.5, high=100.0
    )
    min_span: float = setting(
        12.0, 'shortest distance between two supports', unit='m', low=2.0, high=1000.0
    )
    max_reach: float = setting(
        40.0, 'a conductor that fades out is extended this far to its support', unit='m',
        low=1.0, high=300.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CorridorSettings(Checked):
    """The power line corridor, PLC (Eq. 9)."""

    environment: str = setting(
        'auto',
        'case of Eq. 9: complex where things stand higher than the line, else open',
        choices=('auto', 'complex', 'open'),
    )
    radius: float = setting(
        0.0, 'search radius about a conductor (r of Table 1), 0: by Eq. 9', unit='m', low=0.0,
        high=100.0,
    )
    max_radius: float = setting(
        20.0, 'upper bound of the radius of Eq. 9', unit='m', low=0.6, high=200.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HazardSettings(Checked):
    """Clearance rules of the plain default set, interference and abnormal sag."""

    warning_distance: float = setting(
        4.0, 'vegetation nearer than this is a warning', unit='m', low=0.0, high=100.0
    )
    critical_distance: float = setting(
        2.0, 'vegetation nearer than this is critical', unit='m', low=0.0, high=100.0
    )
    ground_distance: float = setting(
        5.0, 'least height of a conductor above ground', unit='m', low=0.0, high=100.0
    )
    crossing_distance: float = setting(
        2.0, 'least distance between crossing lines, 0: not looked at', unit='m', low=0.0,
        high=100.0,
    )
    fall_distance: float = setting(
        0.0, 'least distance of a falling tree from a conductor, 0: not looked at', unit='m',
        low=0.0, high=100.0,
    )
    rules: str = setting(
        'plain', 'rule set: plain for the distances above, a name in config/rules or a file'
    )
    voltage: float = setting(
        0.0, 'nominal voltage that rule sets ask for, 0: unknown', unit='kV', low=0.0, high=2000.0
    )
    elevation: float = setting(
        -1000.0, 'elevation that rule sets ask for, below -500: unknown', unit='m', low=-1000.0,
        high=9000.0,
    )
    growth: float = setting(
        0.0, 'growth of vegetation towards the conductors a year, 0: unknown', unit='m', low=0.0,
        high=10.0,
    )
    interference_ratio: float = setting(
        0.5, 'conductors nearer in the span than this share of their distance at the supports',
        low=0.0, high=1.0,
    )
    sag_deviation: float = setting(
        0.25, 'sag beyond its peers by this share is abnormal', low=0.01, high=10.0
    )
    min_points: int = setting(3, 'fewest points of a hazard', low=1, high=10_000)
    min_confidence: float = setting(
        0.2, 'hazards that are less sure to break any limit are not raised', low=0.0, high=1.0
    )
    group_distance: float = setting(
        2.0, 'offending points within this distance are one hazard', unit='m', low=0.1, high=50.0
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
    proximity: ProximitySettings = field(default_factory=ProximitySettings)
    output: OutputSettings = field(default_factory=OutputSettings)
    stream: StreamSettings = field(default_factory=StreamSettings)
    security: SecuritySettings = field(default_factory=SecuritySettings)
