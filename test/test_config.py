# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings: checked, frozen, and the one source of the file and the table made from them."""

import dataclasses
import math
from pathlib import Path

import pytest

from plc_inspect.config import HeightSettings, InputSettings, Settings
from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.parameter_file import read_settings, render_table, render_yaml
from plc_inspect.setting_names import describe, to_mapping, update

ROOT = Path(__file__).parents[1]


def test_committed_parameter_file_is_the_defaults():
    path = ROOT / 'config/plc_inspect.yaml'
    assert path.read_text(encoding='utf-8') == render_yaml(Settings()), 'run make settings'
    assert read_settings(path) == Settings()


def test_committed_table_is_the_defaults():
    text = (ROOT / 'docs/settings.md').read_text(encoding='utf-8')
    assert text == render_table(), 'run make settings'


def test_every_setting_is_described():
    names = []
    for name, default, meta in describe():
        names.append(name)
        assert meta['description'], name
        assert not meta['description'].endswith('.'), name
        values = default if isinstance(default, tuple) else (default,)
        for value in values:
            if isinstance(value, int | float) and not isinstance(value, bool):
                assert meta['low'] <= value <= meta['high'], name
                assert math.isfinite(meta['low']), name
                assert math.isfinite(meta['high']), name
    assert len(names) == len(set(names))
    assert names == [f'{section}.{name}' for section, values in to_mapping(Settings()).items()
                     for name in values]


def test_every_bound_is_enforced():
    for name, default, meta in describe():
        if isinstance(default, tuple) or not isinstance(default, int | float):
            continue
        if isinstance(default, bool):
            continue
        for value in (meta['low'], meta['high']):
            assert update(Settings(), {name: type(default)(value)})
        for value in (meta['low'] - 1, meta['high'] + 1):
            with pytest.raises(ConfigError, match=name.partition('.')[2]):
                update(Settings(), {name: type(default)(value)})


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().height.beta = 5.0


@pytest.mark.parametrize('value', [True, '4', None, math.nan, math.inf, [4.0]])
def test_wrong_types_of_a_number(value):
    with pytest.raises(ConfigError, match='beta'):
        HeightSettings(beta=value)


@pytest.mark.parametrize('value', [4.0, True, '100'])
def test_wrong_types_of_a_count(value):
    with pytest.raises(ConfigError, match='num_bins'):
        HeightSettings(num_bins=value)


def test_positions_have_three_numbers():
    assert InputSettings(lidar_xyz=(1.0, 2.0, 3.0)).lidar_xyz == (1.0, 2.0, 3.0)
    for value in ((1.0, 2.0), (), [1.0, 2.0, 3.0], (1.0, 2.0, 'x')):
        with pytest.raises(ConfigError, match='lidar_xyz'):
            InputSettings(lidar_xyz=value)


def test_update_changes_only_what_it_names():
    base = Settings()
    changed = update(base, {'height': {'beta': 6}, 'input.lidar_xyz': [1, 2, 3]})
    assert changed.height.beta == 6.0
    assert type(changed.height.beta) is float
    assert changed.input.lidar_xyz == (1.0, 2.0, 3.0)
    assert base == Settings()
    assert dataclasses.replace(changed, height=base.height, input=base.input) == base


def test_mapping_goes_round():
    settings = update(Settings(), {'height.beta': 5.5, 'corridor.environment': 'open'})
    assert update(Settings(), to_mapping(settings)) == settings
