# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A headless Chromium, where one is installed, prints the report."""

from pathlib import Path
import shutil
import subprocess
import tempfile

from plc_inspect.errors import ConfigError, DataError

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
TIMEOUT = 120.0
"""Longer than this no page takes to print [s]."""
FLAGS = (
    '--headless', '--no-sandbox', '--disable-gpu', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader', '--disable-background-networking', '--hide-scrollbars',
    '--disable-dev-shm-usage', '--no-first-run',
)


def find_browser() -> str:
    """
    Return the path of an installed Chromium.

    Raises
    ------
    ConfigError
        None is installed.

    """
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        raise ConfigError(
            f'printing the report needs one of {", ".join(BROWSERS)}, and none is installed'
        )
    return found


def take_screenshot(page: Path, path: Path, width: int = 1200, height: int = 2400) -> None:
    """
    Take a picture of the top of a page, when all of it is drawn.

    Parameters
    ----------
    page : Path
        An HTML file.
    path : Path
        The PNG to write.
    width, height : int
        Of the window [px].

    Raises
    ------
    ConfigError
        No Chromium is installed.
    DataError
        It did not show the page.

    """
    _run(page, path, f'--window-size={width},{height}', '--virtual-time-budget=8000',
         f'--screenshot={path.absolute()}')


def print_pdf(page: Path, path: Path) -> None:
    """
    Print a page.

    Parameters
    ----------
    page : Path
        An HTML file.
    path : Path
        The PDF to write.

    Raises
    ------
    ConfigError
        No Chromium is installed.
    DataError
        It did not print the page.

    """
    _run(page, path, '--no-pdf-header-footer', '--virtual-time-budget=20000',
         f'--print-to-pdf={path.absolute()}')


def _run(page: Path, path: Path, *arguments: str) -> None:
    """Run the browser on a page, in a profile of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [
            find_browser(), *FLAGS, f'--user-data-dir={profile}', *arguments,
            page.absolute().as_uri(),
        ]
        try:
            done = subprocess.run(command, capture_output=True, timeout=TIMEOUT, check=False)
        except subprocess.TimeoutExpired as error:
            raise DataError(f'{page.name} was not drawn within {TIMEOUT:g} s') from error
    if done.returncode or not path.exists() or not path.stat().st_size:
        text = done.stderr.decode('utf-8', 'replace').strip().splitlines()
        raise DataError(f'{page.name} was not drawn: {text[-1] if text else done.returncode}')
