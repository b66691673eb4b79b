# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The onboard node on a robot.

The transport for large clouds is set for the node; the driver needs the same environment, so
include this file and the driver's in one launch file after SetEnvironmentVariable, or export it.
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """Describe the node with its parameters and remappings."""
    share = get_package_share_directory('plc_inspect')
    return LaunchDescription([
        DeclareLaunchArgument('params', default_value=os.path.join(
            share, 'config', 'plc_inspect.yaml')),
        DeclareLaunchArgument('scans', default_value='velodyne_points'),
        DeclareLaunchArgument('odometry', default_value='odometry'),
        DeclareLaunchArgument('output', default_value=''),
        DeclareLaunchArgument('use_sim_time', default_value='false'),
        SetEnvironmentVariable(
            'FASTRTPS_DEFAULT_PROFILES_FILE', os.path.join(share, 'config', 'fastdds.xml')),
        Node(
            package='plc_inspect',
            executable='plc_node',
            name='plc_inspect',
            output='screen',
            # Results are written at the end: give them time before SIGKILL.
            sigterm_timeout='60',
            sigkill_timeout='60',
            parameters=[LaunchConfiguration('params'), {
                'output.directory': LaunchConfiguration('output'),
                'use_sim_time': LaunchConfiguration('use_sim_time'),
            }],
            remappings=[
                ('velodyne_points', LaunchConfiguration('scans')),
                ('odometry', LaunchConfiguration('odometry')),
            ],
        ),
    ])
