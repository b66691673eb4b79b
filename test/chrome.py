# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A headless Chromium of the distribution, driven by playwright."""

import atexit
from functools import cache
from pathlib import Path
import time

from playwright.sync_api import Playwright, sync_playwright

FLAGS = (
    '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--disable-background-networking', '--disable-dev-shm-usage', '--no-first-run',
    '--hide-scrollbars', '--disable-quic', '--disable-component-update', '--disable-sync',
)
WAIT_MS = 40_000


@cache
def _play() -> Playwright:
    """Start playwright once for the process: it cannot run twice."""
    play = sync_playwright().start()
    atexit.register(play.stop)
    return play


class Chrome:
    """One browser with one page."""

    def __init__(self, program, profile, width=1280, height=800, *, phone=False, light=False):
        self._context = _play().chromium.launch_persistent_context(
            profile, executable_path=program, args=FLAGS, headless=True,
            viewport={'width': width, 'height': height}, is_mobile=phone, has_touch=phone,
            device_scale_factor=2 if phone else 1, color_scheme='light' if light else 'dark',
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
