# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Installs plc_inspect as an ament_python package and as a plain Python package."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'plc_inspect'

COMMANDS = {
    'plc_node': 'plc_inspect.ros.node.onboard:main',
    'plc_play': 'plc_inspect.ros.play:main',
    'plc_survey': 'plc_inspect.offline.commands.survey:main',
    'plc_compare': 'plc_inspect.offline.commands.compare:main',
    'plc_replay': 'plc_inspect.offline.commands.replay:main',
    'plc_recover': 'plc_inspect.offline.commands.recover:main',
    'plc_tune': 'plc_inspect.offline.commands.tune:main',
    'plc_simulate': 'plc_inspect.sim.simulate:main',
    'plc_monitor': 'plc_inspect.monitor.command:main',
    'plc_evaluate': 'plc_inspect.sim.evaluation.evaluate:main',
    'plc_explain': 'plc_inspect.offline.commands.explain:main',
    'plc_keys': 'plc_inspect.security.command:main',
}


def list_files(folder: str, *patterns: str) -> list[str]:
    """List the files of one folder that match any of the patterns, sorted."""
    return sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))


setup(
    name=NAME,
    version='0.1.0',
    description='Power line inspection from LiDAR: conductors, corridor and hazards',
    author='plc_inspect contributors',
    maintainer='plc_inspect contributors',
    maintainer_email='plc_inspect@example.org',
    license='Apache-2.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: [
        'grid/templates/*',
        'monitor/page/*.*', 'monitor/page/vendor/three/LICENSE',
        'monitor/page/vendor/three/*.js', 'monitor/page/vendor/three/*/*.js',
        'offline/report/templates/*',
    ]},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', list_files('config', '*.yaml', '*.rviz', '*.json', '*.xml')),
        (f'share/{NAME}/config/rules', list_files('config/rules', '*.yaml')),
        (f'share/{NAME}/config/security', list_files('config/security', '*.xml')),
        (f'share/{NAME}/launch', list_files('launch', '*.launch.py')),
    ],
    python_requires='>=3.11',
    # Bounded above where releases have changed what is called here: majors, and minors below 1.0.
    install_requires=[
        'setuptools',
        'aiohttp>=3.9,<4',
        'cma>=4.0,<5',
        'cryptography>=41',
        'ezdxf>=1.1,<2',
        'jinja2>=3.1,<4',
        'laspy[lazrs]>=2.5,<3',
        'mcap>=1.0,<2',
        'numba>=0.58',
        'numpy>=1.26,<3',
        'pyogrio>=0.7',
        'pyproj>=3.6,<4',
        'PyYAML>=6.0,<7',
        'rich>=13.3.3',
        'rosbags>=0.10,<0.12',
        'scikit-learn>=1.4,<2',
        'scipy>=1.11,<2',
        'shapely>=2.0,<3',
        'tqdm>=4.65',
        'zstandard>=0.20',
    ],
    extras_require={
        'grid': ['dask>=2024.8', 'distributed>=2024.8', 'pyarrow>=17'],
        'pdf': ['pypdf>=4'],
        'formats': ['plyfile>=1.0', 'pye57>=0.4.11'],
        'fuzz': ['atheris>=3.0,<4'],
        'dev': [
            'colorspacious>=1.1',
            'dask>=2024.8',
            'distributed>=2024.8',
            'hypothesis>=6.90',
            'laszip>=0.2',
            'matplotlib>=3.8',
            'mypy>=1.10',
            'pillow>=10',
            'playwright>=1.40',
            'plyfile>=1.0',
            'pyarrow>=17',
            'pye57>=0.4.11',
            'pypdf>=4',
            'pyte>=0.8',
            'pytest>=8.0',
            'pytest-rerunfailures>=14',
            'pytest-xdist>=3.5',
            'ruff>=0.8',
            'types-PyYAML',
            'types-tqdm',
        ],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [f'{name} = {target}' for name, target in COMMANDS.items()],
    },
)
