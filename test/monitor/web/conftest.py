# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A browser, and a flight that it looks at."""

from monitor.web.chrome import Chrome, stop_playing
from monitor.web.flight import Flight, STATE
import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.offline.report.browser import find_browser


@pytest.fixture(scope='module')
def program():
    """Find the browser, or say that there is none; what drives it ends with the module."""
    try:
        yield find_browser()
    except ConfigError as error:
        pytest.skip(str(error))
    stop_playing()


@pytest.fixture
def flight(tmp_path):
    """Return a graph for processes."""
    flight = Flight(tmp_path)
    yield flight
    flight.close()


@pytest.fixture
def browse(program, tmp_path):
    """Return a function that opens a page; the browsers are closed after the test."""
    browsers = []

    def browse(address, width=1280, height=800, token='', **options):
        chrome = Chrome(program, tmp_path / f'profile{len(browsers)}', width, height, **options)
        browsers.append(chrome)
        chrome.open(address)
        if token:
            chrome.page.fill('input[name=token]', token)
            chrome.page.press('input[name=token]', 'Enter')
        chrome.wait(f"{STATE} != 'connecting'")
        return chrome

    yield browse
    errors = [error for chrome in browsers for error in chrome.errors]
    for chrome in browsers:
        chrome.close()
    assert errors == []
