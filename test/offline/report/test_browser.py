# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The report in a real browser: drawn, quick, sortable, printed."""

import dataclasses
import os
from pathlib import Path
import re
import subprocess
import tempfile

from factories import make_inspection
import numpy as np
from PIL import Image
import pypdf
import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.offline.report import browser, paper
from plc_inspect.offline.report.browser import (
    find_browser,
    FLAGS,
    NO_SANDBOX,
    NOBODY,
    print_pdf,
    take_screenshot,
)
from plc_inspect.offline.report.paper import check_printing, list_contents, print_report
from plc_inspect.offline.report.report import render_report
from plc_inspect.results import Severity

pytestmark = pytest.mark.slow

PROBE = """<script>
document.querySelectorAll('#hazards th')[1].click();
document.body.dataset.order = [...document.querySelectorAll('#hazards tbody tr')]
  .map((row) => row.id.slice(7)).join();
document.querySelector('[data-show="3"]').click();
document.body.dataset.near = window.view.distance < 50;
</script></body>"""


@pytest.fixture(scope='module')
def chromium():
    """Find the browser, or say that there is none."""
    try:
        return find_browser()
    except ConfigError as error:
        pytest.skip(str(error))


def make_long_inspection(copies=10):
    """Make a survey of twenty spans, a million points and ten hazards."""
    parts = [make_inspection(origin=(240.0 * k, 0.0, 0.0), num_ground=100_000, seed=k)
             for k in range(copies)]
    spans, hazards, supports = [], [], []
    for k, part in enumerate(parts):
        result = part.result
        spans += [dataclasses.replace(item, span_id=item.span_id + 2 * k) for item in result.spans]
        hazards += [
            dataclasses.replace(item, span_id=2 * k, hazard_id=k, severity=Severity(1 + k % 3))
            for item in result.hazards
        ]
        supports += [dataclasses.replace(item, support_id=3 * k + item.support_id)
                     for item in result.supports]
    arrays = {
        name: np.concatenate([getattr(part.result, name) for part in parts])
        for name in ('line_id', 'residual', 'clearance', 'classification', 'decision',
                     'ground_height', 'corridor_line_id')
    }
    first = np.cumsum([0, *(len(part.points) for part in parts)])
    for name, step in (('span_id', 2), ('corridor_span_id', 2)):
        arrays[name] = np.concatenate(
            [getattr(part.result, name) + step * k for k, part in enumerate(parts)]
        ).astype(np.int32)
    arrays['corridor'] = np.concatenate(
        [part.result.corridor + first[k] for k, part in enumerate(parts)]
    )
    result = dataclasses.replace(
        parts[0].result, spans=tuple(spans), hazards=tuple(hazards), supports=tuple(supports),
        **arrays,
    )
    return dataclasses.replace(
        parts[0], result=result, points=np.concatenate([part.points for part in parts])
    )


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    """Write the report of the long survey."""
    path = tmp_path_factory.mktemp('report') / 'report.html'
    path.write_text(render_report(make_long_inspection()), encoding='utf-8')
    return path


def run(chromium, profile, page, *arguments):
    done = subprocess.run(
        [chromium, *FLAGS, NO_SANDBOX, f'--user-data-dir={profile}', '--window-size=1200,2400',
         *arguments, page.as_uri()],
        capture_output=True, timeout=90, check=True, text=True,
    )
    return done.stdout


def test_twenty_spans_are_drawn_in_time(chromium, page, tmp_path):
    assert page.stat().st_size < 15e6
    dom = run(chromium, tmp_path, page, '--timeout=10000', '--dump-dom')
    assert int(re.search(r'data-first-view="(\d+)"', dom)[1]) < 3000
    assert dom.count('class="pin"') == 10
    assert dom.count('<article') == 20


def test_tables_sort_and_hazards_are_shown(chromium, page, tmp_path):
    probed = tmp_path / 'probed.html'
    probed.write_text(page.read_text(encoding='utf-8').replace('</body>', PROBE),
                      encoding='utf-8')
    dom = run(chromium, tmp_path / 'profile', probed, '--timeout=10000', '--dump-dom')
    assert re.search(r'data-order="([\d,]+)"', dom)[1] == '2,5,8,1,4,7,0,3,6,9'
    assert 'data-near="true"' in dom


def test_screenshot_shows_points_lines_and_hazards(chromium, page, tmp_path):
    assert chromium
    shot = tmp_path / 'shot.png'
    take_screenshot(page, shot)
    pixels = np.asarray(Image.open(shot).convert('RGB')).astype(int)
    assert pixels.shape == (2400, 1200, 3)
    red, green, blue = np.moveaxis(pixels, 2, 0)
    sand = (red > 130) & (red > blue + 25) & (red >= green)
    badge = (abs(red - 0xC1) < 4) & (abs(green - 0x12) < 4) & (abs(blue - 0x1F) < 4)
    assert sand.sum() > 20_000
    assert badge.sum() > 300


def test_pdf(chromium, page, tmp_path):
    path = tmp_path / 'report.pdf'
    print_pdf(page, path)
    data = path.read_bytes()
    assert data.startswith(b'%PDF')
    assert len(re.findall(rb'/Type\s*/Page\b', data)) > 5


def test_a_printed_report_has_contents_and_a_page_for_each_hazard(chromium, tmp_path):
    assert chromium
    inspection = make_long_inspection(4)
    sizes = {'A4': (594.96, 841.92), 'Letter': (612.0, 792.0)}
    for size, (width, height) in sizes.items():
        path = tmp_path / f'{size}.pdf'
        print_report(lambda own: render_report(inspection, paper=own), size, path)
        assert list(tmp_path.glob('*.html')) == []
        pages = pypdf.PdfReader(path).pages
        texts = [page.extract_text() for page in pages]
        assert {(round(float(page.mediabox.width), 2), round(float(page.mediabox.height), 2))
                for page in pages} == {(width, height)}
        titles = {title for _, title, _ in list_contents(
            [], worst=True, coverage=True, what_if=True, changes=True)}
        sheets = {}
        for number, text in enumerate(texts, start=1):
            assert f'page {number} of {len(texts)}' in text
            assert re.search(r'\d{4}-\d\d-\d\d', text)
            lines = [line.strip() for line in text.splitlines() if line.strip()]
            lines = [line for line in lines if not re.search(r'page \d+ of|^\S+, \d{4}-', line)]
            assert len(lines) > 3, f'page {number} is empty'
            assert lines[-1] not in titles, f'page {number} ends with a heading'
            found = re.match(r'Hazard (\d+)', lines[0])
            if found:
                sheets[int(found[1])] = number
                assert 'Seen from beside the line' in text
        assert sorted(sheets) == [item.hazard_id for item in inspection.result.hazards]
        for hazard, number in sheets.items():
            assert re.search(rf'Hazard {hazard}: \w+, \w+\s+{number}\b', ' '.join(texts[:2]))


def test_paper_must_be_known(chromium, monkeypatch):
    assert chromium
    with pytest.raises(ConfigError, match="--paper must be one of A4, Letter, got 'A5'"):
        check_printing('A5')
    monkeypatch.setattr(paper, 'PACKAGE', 'no_such_package')
    with pytest.raises(ConfigError, match='--pdf needs the Python package no_such_package'):
        check_printing('A4')


def test_without_a_browser_it_is_said(monkeypatch, page, tmp_path):
    monkeypatch.setattr(browser, 'BROWSERS', ('no-such-browser',))
    with pytest.raises(ConfigError, match='needs one of no-such-browser'):
        print_pdf(page, tmp_path / 'report.pdf')


@pytest.fixture
def shelf():
    """Return a folder that everyone may read."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


def test_it_is_in_its_sandbox_or_a_user_without_rights(tmp_path, shelf, monkeypatch):
    program = shelf / 'chromium'
    program.write_text("""#!/bin/sh
for item in "$@"; do case $item in --screenshot=*) out=${item#--screenshot=};; esac; done
{ id -un; cat "$(echo "$item" | sed s,file://,,)"; echo "$@"; env; } > "$out"
""")
    program.chmod(0o755)
    monkeypatch.setenv('PATH', f'{shelf}:{os.environ["PATH"]}')
    monkeypatch.setenv('SECRET', 'of the shell')
    (tmp_path / 'page.html').write_text('the page')
    (tmp_path / 'page.html').chmod(0o600)  # root's alone
    take_screenshot(tmp_path / 'page.html', tmp_path / 'page.png')
    user, page, arguments, *rest = (tmp_path / 'page.png').read_text().replace(
        'the page', 'the page\n').splitlines()
    assert page == 'the page'
    if os.geteuid() == 0:
        assert user == NOBODY
        assert not any('SECRET' in line for line in rest)
    else:
        assert NO_SANDBOX not in arguments
