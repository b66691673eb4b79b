# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The look for known vulnerabilities: what was not looked up never counts as good."""

import importlib.util
import json
from pathlib import Path
import zipfile

import pytest

ROOT = Path(__file__).parents[2]
RECORD = {
    'id': 'PYSEC-2000-1',
    'affected': [{
        'package': {'ecosystem': 'PyPI', 'name': 'Toy.Package'},
        'ranges': [{'type': 'ECOSYSTEM', 'events': [
            {'introduced': '0'}, {'fixed': '1.2'}, {'introduced': '2.0'}, {'fixed': '2.1'},
        ]}],
        'versions': ['3.0'],
    }],
}


@pytest.fixture(scope='module')
def audit():
    """Load the tool as a module."""
    spec = importlib.util.spec_from_file_location('audit', ROOT / 'tools/audit.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def lock(tmp_path):
    """Return a function that writes a lock file of one package."""

    def write(version):
        path = tmp_path / 'lock'
        path.write_text(f'# made\ntoy-package=={version} ; python_version < "4" \\\n'
                        '    --hash=sha256:00\n')
        return path

    return write


def test_our_lock_is_read_whole(audit):
    lock = audit.read_lock(ROOT / 'requirements.lock')
    assert len(lock) > 100
    assert lock['ros-jazzy-rclpy'] == '7.1.6'
    assert {'aiohttp', 'cryptography', 'numpy'} <= set(lock)


@pytest.mark.parametrize(('version', 'affected'), [
    ('0.9', True), ('1.1.9', True), ('1.2', False), ('1.9', False), ('2.0', True),
    ('2.1', False), ('3.0', True), ('3.0.0', True), ('3.1', False),
])
def test_versions_are_within_ranges_or_listed(audit, lock, version, affected):
    found = audit.search_dump([RECORD], audit.read_lock(lock(version)))
    assert [item.advisory for item in found] == ['PYSEC-2000-1'] * affected
    assert not audit.search_dump([RECORD | {'withdrawn': '2001'}], {'toy-package': '0.9'})
    assert not audit.search_dump([RECORD], {'toy': '0.9'})


def test_a_dump_is_searched_without_a_network(audit, lock, tmp_path, capsys):
    path = tmp_path / 'all.zip'
    with zipfile.ZipFile(path, 'w') as archive:
        archive.writestr('PYSEC-2000-1.json', json.dumps(RECORD))
    assert audit.main([str(lock('1.0')), '--osv', str(path)]) == 1
    assert 'audit: toy-package 1.0: PYSEC-2000-1, mended in 1.2, 2.1' in capsys.readouterr().out
    assert audit.main([str(lock('1.3')), '--osv', str(path)]) == 0
    assert '1 of 1 packages looked up, 0 known' in capsys.readouterr().out
    path.write_bytes(b'nothing')
    assert audit.main([str(lock('1.3')), '--osv', str(path)]) == 2
    assert 'is no dump of OSV' in capsys.readouterr().out


def test_what_pip_audit_skips_is_not_good(audit, lock, monkeypatch, capsys):
    report = {'dependencies': [{'name': 'toy-package', 'skip_reason': 'not found'}]}
    known, reason = audit.sort_report(report)
    assert (known, reason) == ({}, 'not found')
    monkeypatch.setattr(audit, 'ask_pip_audit', lambda path: audit.sort_report(report))
    page = {'info': {'version': '2.0'}, 'vulnerabilities': [{'id': 'X-1', 'fixed_in': []}]}
    monkeypatch.setattr(audit, 'ask_index', lambda *own: audit.judge_page(page, *own))
    assert audit.main([str(lock('2.0.0'))]) == 1
    assert 'X-1, not mended yet' in capsys.readouterr().out
    assert audit.main([str(lock('1.0'))]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith('audit: 0 of 1 packages looked up, 0 known vulnerabilities; not')
    page['vulnerabilities'] = []
    assert audit.main([str(lock('2.0'))]) == 0


def test_without_an_index_one_line_says_so(audit, lock, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(audit.sys, 'executable', str(tmp_path / 'python'))

    def fail(*_, **__):
        raise OSError('no network')

    monkeypatch.setattr(audit.urllib.request, 'urlopen', fail)
    assert audit.main([str(lock('1.0'))]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert 'No such file' in lines[0]
    assert lines[-1].endswith('not looked up: toy-package, as the index does not tell of it: '
                              'no network')
