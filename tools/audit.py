#!/usr/bin/env python3
# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Looks for known vulnerabilities in what a lock file names, and says what it could not look up.

pip-audit asks the package index release by release.  An index that knows no releases by
themselves makes it skip them all, and it still ends with "No known vulnerabilities found" and 0.
What it skipped is therefore asked for by name, which tells of the newest release alone; what is
locked to an older one stays unknown.  With ``--osv`` nothing is asked: a dump of OSV (all.zip of
the ecosystem PyPI) is read.  Exit codes: 0 all looked up and nothing found, 1 something found,
2 not all looked up.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import gzip
import json
from pathlib import Path
import re
import subprocess
import sys
from typing import Any
import urllib.error
import urllib.request
import zipfile

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

PATIENCE = 60.0
"""Longest wait for the index to tell of one package [s]."""
PINNED = re.compile(r'^([A-Za-z0-9._-]+)==([^ ;\\]+)')
MOST_NAMED = 8
"""So many packages that were not looked up are named."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A known vulnerability of a package that is locked."""

    name: str
    version: str
    advisory: str
    fixed_in: tuple[str, ...]

    def describe(self) -> str:
        """Return it in one line."""
        mended = f'mended in {", ".join(self.fixed_in)}' if self.fixed_in else 'not mended yet'
        return f'{self.name} {self.version}: {self.advisory}, {mended}'


def read_lock(path: Path) -> dict[str, str]:
    """Return the version of each package that a lock file names, by canonical name."""
    lines = path.read_text(encoding='utf-8').splitlines()
    found = {
        str(canonicalize_name(match[1])): match[2]
        for line in lines if (match := PINNED.match(line))
    }
    if not found:
        raise SystemExit(f'audit: {path} names no package')
    return found


def ask_pip_audit(lock: Path) -> tuple[dict[str, list[Finding]], str]:
    """Return what pip-audit knows, by package, and why it knows no more, '' for no reason."""
    command = [
        str(Path(sys.executable).with_name('pip-audit')), '-r', str(lock), '--require-hashes',
        '--disable-pip', '--format', 'json', '--progress-spinner', 'off',
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        report = json.loads(done.stdout)
    except (OSError, ValueError) as error:
        said = done.stderr.strip().splitlines() if isinstance(error, ValueError) else [str(error)]
        return {}, said[-1] if said else 'pip-audit says nothing'
    return sort_report(report)


def sort_report(report: Mapping[str, Any]) -> tuple[dict[str, list[Finding]], str]:
    """Return what a report of pip-audit knows, as ``ask_pip_audit``."""
    known, reason = {}, ''
    for item in report['dependencies']:
        name = str(canonicalize_name(item['name']))
        if 'skip_reason' in item:
            reason = item['skip_reason']
            continue
        known[name] = [
            Finding(name, item['version'], found['id'], tuple(found['fix_versions']))
            for found in item['vulns']
        ]
    return known, reason


def ask_index(name: str, version: str) -> tuple[list[Finding] | None, str]:
    """Return what the index knows of a package's newest release, None and why if not ours."""
    from pip._internal.models.index import PyPI

    request = urllib.request.Request(
        f'{PyPI.pypi_url}/{name}/json', headers={'Accept-Encoding': 'gzip'}
    )
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            data = answer.read()
            if answer.headers.get('Content-Encoding') == 'gzip':
                data = gzip.decompress(data)
        return judge_page(json.loads(data), name, version)
    except (OSError, ValueError, KeyError) as error:  # of urllib too
        return None, f'the index does not tell of it: {error}'


def judge_page(
    page: Mapping[str, Any], name: str, version: str
) -> tuple[list[Finding] | None, str]:
    """Return what the index's page of a package tells of a release, as ``ask_index``."""
    newest = page['info']['version']
    if Version(newest) != Version(version):
        return None, f'the index tells of newer releases alone ({newest}, not {version})'
    return [
        Finding(name, version, item['id'], tuple(item.get('fixed_in') or ()))
        for item in page['vulnerabilities'] if not item.get('withdrawn')
    ], ''


def search_dump(records: Iterable[Mapping[str, Any]], lock: Mapping[str, str]) -> list[Finding]:
    """Return what a dump of OSV says of the packages of a lock file."""
    found = []
    for record in records:
        if record.get('withdrawn'):
            continue
        for affected in record.get('affected', ()):
            package = affected.get('package', {})
            name = str(canonicalize_name(package.get('name', '')))
            if package.get('ecosystem') != 'PyPI' or name not in lock:
                continue
            if is_affected(affected, lock[name]):
                fixed = tuple(
                    event['fixed'] for span in affected.get('ranges', ())
                    if span['type'] == 'ECOSYSTEM' for event in span['events'] if 'fixed' in event
                )
                found.append(Finding(name, lock[name], record['id'], fixed))
                break
    return found


def is_affected(affected: Mapping[str, Any], version: str) -> bool:
    """Tell whether a version is among those of an OSV record: listed, or within a range."""
    own = Version(version)
    for text in affected.get('versions', ()):
        try:
            if Version(text) == own:
                return True
        except InvalidVersion:
            continue
    for span in affected.get('ranges', ()):
        if span['type'] != 'ECOSYSTEM':
            continue
        inside = False
        for event in span['events']:  # in order
            if 'introduced' in event:
                inside |= own >= Version(event['introduced'])
            elif 'fixed' in event:
                inside &= own < Version(event['fixed'])
            elif 'last_affected' in event:
                inside &= own <= Version(event['last_affected'])
        if inside:
            return True
    return False


def read_dump(path: Path) -> Iterable[Mapping[str, Any]]:
    """Yield the records of a dump of OSV."""
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.endswith('.json'):
                yield json.loads(archive.read(name))


def main(argv: Sequence[str] | None = None) -> int:
    """Look up a lock file."""
    parser = argparse.ArgumentParser(description='Looks for known vulnerabilities of a lock file.')
    parser.add_argument('lock', type=Path, metavar='LOCK')
    parser.add_argument('--osv', type=Path, metavar='ZIP', help='dump of OSV, in place of asking')
    arguments = parser.parse_args(argv)
    lock = read_lock(arguments.lock)
    unknown: dict[str, str] = {}
    if arguments.osv is not None:
        try:
            found = search_dump(read_dump(arguments.osv), lock)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            print(f'audit: {arguments.osv} is no dump of OSV: {error}')
            return 2
    else:
        known, reason = ask_pip_audit(arguments.lock)
        if reason:
            print(f'audit: pip-audit looked up {len(known)} of {len(lock)} packages: {reason}')
        for name in sorted(set(lock) - set(known)):
            answer, why = ask_index(name, lock[name])
            if answer is None:
                unknown[name] = why
            else:
                known[name] = answer
        found = [item for name in sorted(known) for item in known[name]]
    for item in found:
        print(f'audit: {item.describe()}')
    print(f'audit: {len(lock) - len(unknown)} of {len(lock)} packages looked up, '
          f'{len(found)} known vulnerabilities{describe_unknown(unknown)}')
    return 1 if found else 2 if unknown else 0


def describe_unknown(unknown: Mapping[str, str]) -> str:
    """Return which packages could not be looked up, and why, '' for none."""
    if not unknown:
        return ''
    names = list(unknown)
    named = ', '.join(names[:MOST_NAMED])
    more = f' and {len(names) - MOST_NAMED} more' if len(names) > MOST_NAMED else ''
    return f'; not looked up: {named}{more}, as {unknown[names[0]]}'


if __name__ == '__main__':
    sys.exit(main())
