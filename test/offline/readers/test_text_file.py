# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Files from outside ask for no more than they may: one line, at once, with little memory."""

import os
import random
import resource

import pytest

from plc_inspect.config import Settings
from plc_inspect.errors import ConfigError, DataError, PlcInspectError
from plc_inspect.offline.readers import text_file
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.offline.readers.catalogue import load_conductor, load_rules
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.offline.readers.json_file import read_json
from plc_inspect.offline.readers.parameter_file import read_settings
from plc_inspect.offline.readers.text_file import read_yaml
from plc_inspect.setting_names import update
from plc_inspect.shared_files import find_shared

LAUGHS = 'a: &a {x: 1}\n' + '\n'.join(
    f'{here}: &{here} {{' + ', '.join(f'k{i}: *{before}' for i in range(9)) + '}'
    for before, here in zip('abcdefghi', 'bcdefghij', strict=True)
)
BAD = {
    'impossible date': ('height: {beta: 2024-13-45}', 'beta must be a number'),
    'date': ('height: {beta: 2024-01-02}', 'beta must be a number'),
    'digits': ('height: {beta: ' + '9' * 5000 + '}', 'too large'),
    'digits in hundreds': ('height: {beta: ' + '9' * 500 + '}', 'too large'),
    'list in list': ('[' * 2000 + ']' * 2000, 'more than 20 levels'),
    'map in map': ('{a: ' * 3000 + '1' + '}' * 3000, 'more than 20 levels'),
    'aliases that expand': (LAUGHS, 'or 100000 values'),
    'alias of itself': ('height: &a {beta: *a}', 'a holds itself'),
    'key that is a list': ('? [1, 2]\n: 3', 'is not a YAML file'),
    'many bytes': ('# ' + 'x' * (1 << 18), 'at most 262144 are read'),
    'no text': (b'\xff\xfe\x00', 'not text'),
    'tag': ('height: !!python/object/apply:os.getpid []', 'is not a YAML file'),
}


@pytest.fixture
def little_memory():
    """Let the process take 500 MB more than it has."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    with open('/proc/self/statm', encoding='ascii') as stream:
        size = int(stream.read().split()[0]) * os.sysconf('SC_PAGE_SIZE')
    resource.setrlimit(resource.RLIMIT_AS, (size + 500_000_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize('name', BAD)
@pytest.mark.usefixtures('little_memory')
def test_bad_parameter_files_end_in_one_line(tmp_path, name):
    content, reason = BAD[name]
    path = tmp_path / 'params.yaml'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError) as caught:
        read_settings(path)
    assert reason in str(caught.value)
    assert len(str(caught.value)) < 400
    for read in (
        lambda: load_rules(update(Settings(), {'hazards.rules': str(path)}).hazards),
        lambda: load_conductor('Hawk', path),
    ):
        with pytest.raises(ConfigError):
            read()


@pytest.mark.parametrize('value', ['9' * 5000, '2024-13-45', '&a [*a]', '[' * 2000])
def test_bad_assignments_end_in_one_line(value):
    with pytest.raises(ConfigError) as caught:
        read_settings(None, [f'height.beta={value}'])
    assert len(str(caught.value)) < 300


def test_damaged_rule_sets_and_tables_never_end_in_a_traceback(tmp_path):
    rng = random.Random(5)
    odd = ['-1', '.nan', '[]', '{}', 'null', '2024-13-45', '9' * 5000, 'yes', '&a [*a]', '!!x 1']
    path = tmp_path / 'damaged.yaml'
    texts = [find_shared(f'rules/{name}.yaml').read_text()
             for name in ('en50423_cz', 'nerc_fac_003_4', 'sweden')]
    table = find_shared('conductors.yaml').read_text()
    refused = 0
    for number in range(400):
        lines = rng.choice([*texts, table]).split('\n')
        for _ in range(rng.choice([1, 2, 4])):
            at = rng.randrange(len(lines))
            change = rng.randrange(4)
            if change == 0 and len(lines) > 1:
                del lines[at]
            elif change == 1:
                lines[at] = lines[at].split(':')[0] + ': ' + rng.choice(odd)
            elif change == 2:
                lines.insert(at, rng.choice(lines))
            else:
                lines[at] += rng.choice(['\t', '  x: 1', '\x07', '}', ': ['])
        path.write_text('\n'.join(lines))
        settings = update(Settings(), {
            'hazards.rules': str(path), 'hazards.voltage': 110.0, 'hazards.elevation': 100.0,
        })
        try:
            load_rules(settings.hazards) if number % 2 else load_conductor('Hawk', path)
        except PlcInspectError:
            refused += 1
    assert refused > 100


def test_pipes_are_not_waited_for(tmp_path):
    readers = {
        'a.yaml': lambda path: read_settings(path), 'a.json': read_json, 'a.pcd': read_cloud,
        'a.las': read_cloud, 'a.mcap': lambda path: Recording(path, 'a', 'b').__enter__(),
    }
    for name, read in readers.items():
        os.mkfifo(tmp_path / name)
        with pytest.raises(PlcInspectError, match='regular file'):
            read(tmp_path / name)


@pytest.mark.parametrize('content', ['[' * 100_000, '9' * 5000, '{"a": ' * 50_000])
def test_bad_json_is_an_error_of_ours(tmp_path, content):
    (tmp_path / 'a.json').write_text(content)
    with pytest.raises(DataError, match='is not JSON'):
        read_json(tmp_path / 'a.json')


def test_json_of_any_size_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr('plc_inspect.offline.readers.json_file.MOST_JSON', 10)
    (tmp_path / 'a.json').write_text('{"a": [1, 2, 3]}')
    with pytest.raises(DataError, match='has 16 bytes, at most 10 are read'):
        read_json(tmp_path / 'a.json')


def test_what_may_stand_in_a_file_is_read(tmp_path):
    (tmp_path / 'a.yaml').write_text('a: [1, 2.5, yes, 0x10, -3]\nb: {c: 2024-01-02, d: 1e-3}\n')
    assert read_yaml(tmp_path / 'a.yaml') == {
        'a': [1, 2.5, True, 16, -3], 'b': {'c': '2024-01-02', 'd': '1e-3'},
    }
    assert text_file.parse_yaml('a: &x {b: &y 1}\nc: {<<: *x, d: *y}')['c'] == {'b': 1, 'd': 1}
    assert text_file.parse_yaml(str(2**62)) == 2**62
