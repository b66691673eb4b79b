# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The onboard node on a robot.

The transport for large clouds is set for the node unless the user chose one; the driver needs the
same environment, so include this file and the driver's in one launch file, or export it.
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

TRANSPORT = (
    'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS',
)
"""Variables by which a user chooses the transport; as in plc_inspect/ros/graph/transport.py."""
KEYS = 'PLC_KEYS'
"""Names the keys of this machine; the node takes their transport by itself."""


def _read(context, name):
    return LaunchConfiguration(name).perform(context)


def start_node(context):
    """Return the node; arguments that are left empty leave their parameters to the file."""
    given = {
        'input.odometry_type': _read(context, 'odometry_type'),
        'input.map_frame': _read(context, 'map_frame'),
        'input.base_frame': _read(context, 'base_frame'),
        'output.directory': _read(context, 'output'),
    }
    mount = {
        'input.lidar_xyz': _read(context, 'lidar_xyz'),
        'input.lidar_rpy_deg': _read(context, 'lidar_rpy_deg'),
    }
    parameters = {name: value for name, value in given.items() if value} | {
        name: [float(item) for item in value.strip('[]').replace(',', ' ').split()]
        for name, value in mount.items() if value
    }
    parameters['use_sim_time'] = _read(context, 'use_sim_time').lower() in ('true', '1')
    return [Node(
        package='plc_inspect',
        executable='plc_node',
        name='plc_inspect',
        namespace=_read(context, 'namespace'),
        output='screen',
        # Results are written at the end, within 120 s: give them time before SIGKILL.
        sigterm_timeout='130',
        sigkill_timeout='130',
        parameters=[_read(context, 'params'), parameters],
        remappings=[
            ('velodyne_points', _read(context, 'scans')),
            ('odometry', _read(context, 'odometry')),
            ('/tf', _read(context, 'tf')),
            ('/tf_static', _read(context, 'tf_static')),
        ],
    )]


def generate_launch_description():
    """Describe the node with its parameters and remappings."""
    share = get_package_share_directory('plc_inspect')
    profile = os.path.join(share, 'config', 'fastdds.xml')
    own = [] if any(os.environ.get(name) for name in (*TRANSPORT, KEYS)) else [
        SetEnvironmentVariable(TRANSPORT[0], profile)
    ]
    return LaunchDescription([
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of the vehicle: of node, results, scans and odometry'),
        DeclareLaunchArgument(
            'params', default_value=os.path.join(share, 'config', 'plc_inspect.yaml'),
            description='YAML file of parameters, of which docs/settings.md tells'),
        DeclareLaunchArgument(
            'scans', default_value='velodyne_points',
            description='topic of the scans (sensor_msgs/PointCloud2)'),
        DeclareLaunchArgument(
            'odometry', default_value='odometry',
            description='topic of the poses (Odometry, PoseStamped, PoseWithCovarianceStamped)'),
        DeclareLaunchArgument(
            'odometry_type', default_value='',
            description='type of that topic; auto: the one it has; tf: poses from /tf'),
        DeclareLaunchArgument(
            'map_frame', default_value='',
            description='frame of the map, where poses come from /tf'),
        DeclareLaunchArgument(
            'base_frame', default_value='',
            description='frame that the poses are of, where their messages do not tell'),
        DeclareLaunchArgument(
            'lidar_xyz', default_value='',
            description='position of the lidar on the base, "x y z" [m]; else from /tf_static'),
        DeclareLaunchArgument(
            'lidar_rpy_deg', default_value='',
            description='roll, pitch and yaw of the lidar on the base, "r p y" [degrees]'),
        DeclareLaunchArgument(
            'tf', default_value='/tf', description='topic that stands for /tf'),
        DeclareLaunchArgument(
            'tf_static', default_value='/tf_static',
            description='topic that stands for /tf_static'),
        DeclareLaunchArgument(
            'output', default_value='',
            description='results folder; empty: a new one below ~/.ros/plc_inspect'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false', description='take time from /clock'),
        *own,
        OpaqueFunction(function=start_node),
    ])
