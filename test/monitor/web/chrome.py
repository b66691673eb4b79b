# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A headless Chromium of the distribution, driven by playwright; and what eyes see of colours."""

from functools import cache
from pathlib import Path
import time

from colorspacious import cspace_convert
import numpy as np
from playwright.sync_api import Playwright, sync_playwright

from plc_inspect.colors import parse_color

FLAGS = (
    '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--disable-background-networking', '--disable-dev-shm-usage', '--no-first-run',
    '--hide-scrollbars', '--disable-quic', '--disable-component-update', '--disable-sync',
)
WAIT_MS = 40_000
EYES = ('normal', 'deuteranomaly', 'protanomaly', 'tritanomaly')
LEAST_DISTANCE = 25.0
"""In CAM02-UCS, where 1 can just be told apart side by side; the colours before had 9."""


def see(color, eye):
    """Return where a colour lies in CAM02-UCS, as an eye sees it that misses a kind of cone."""
    rgb = np.array(parse_color(color)) / 255.0
    if eye != 'normal':
        space = {'name': 'sRGB1+CVD', 'cvd_type': eye, 'severity': 100}
        rgb = np.clip(cspace_convert(rgb, space, 'sRGB1'), 0.0, 1.0)
    return cspace_convert(rgb, 'sRGB1', 'CAM02-UCS')


@cache
def _play() -> Playwright:
    """Start playwright once for the process: it cannot run twice."""
    return sync_playwright().start()


def stop_playing():
    """Stop playwright, whose loop stands in the way of other loops of the thread."""
    if _play.cache_info().currsize:
        _play().stop()
        _play.cache_clear()


class Chrome:
    """One browser with one page."""

    def __init__(self, program, profile, width=1280, height=800, *, phone=False, light=False):
        self._context = _play().chromium.launch_persistent_context(
            profile, executable_path=program, args=FLAGS, headless=True,
            viewport={'width': width, 'height': height}, is_mobile=phone, has_touch=phone,
            color_scheme='light' if light else 'dark',
        )
        self.page = self._context.pages[0]
        self.page.set_default_timeout(WAIT_MS)
        self.errors = []
        """What went wrong in the page's own program."""
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))

    def open(self, address):
        """Go to a page."""
        self.page.goto(address)

    def run(self, expression):
        """Return what a JavaScript expression gives."""
        return self.page.evaluate(expression)

    def wait(self, expression, deadline=40.0):
        """Wait until an expression gives something true, and return it."""
        end = time.monotonic() + deadline  # what waits within the page is against its policy
        while time.monotonic() < end:
            value = self.run(expression)
            if value:
                return value
            self.page.wait_for_timeout(50)
        raise AssertionError(f'{expression} never came true')

    def take_picture(self, path):
        """Write a PNG of what is seen."""
        Path(path).write_bytes(self.page.screenshot())

    def close(self):
        """End the browser."""
        self._context.close()
