# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A recording, played to the node, with or without RViz."""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """Describe the node, the player and RViz."""
    share = get_package_share_directory('plc_inspect')
    inspect = PythonLaunchDescriptionSource(os.path.join(share, 'launch', 'inspect.launch.py'))
    return LaunchDescription([
        DeclareLaunchArgument(
            'bag', description='rosbag2 folder, .mcap, .db3 or ROS 1 .bag file'),
        DeclareLaunchArgument(
            'rate', default_value='1.0', description='speed, 1 as it was recorded'),
        DeclareLaunchArgument('rviz', default_value='true', description='show it in RViz'),
        IncludeLaunchDescription(inspect, launch_arguments={'use_sim_time': 'true'}.items()),
        Node(
            package='plc_inspect',
            executable='plc_play',
            arguments=[
                LaunchConfiguration('bag'), '--rate', LaunchConfiguration('rate'), '--wait', '30',
            ],
            output='screen',
            on_exit=Shutdown(),
        ),
        Node(
            package='rviz2',
            executable='rviz2',
            arguments=['-d', os.path.join(share, 'config', 'inspect.rviz')],
            condition=IfCondition(LaunchConfiguration('rviz')),
        ),
    ])
