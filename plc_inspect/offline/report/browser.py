# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Prints the report with a headless Chromium, if one is installed."""

import os
from pathlib import Path
import pwd
import shutil
import subprocess
import tempfile
from typing import Any

from plc_inspect.errors import ConfigError, DataError

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
TIMEOUT = 120.0
"""Longest time to print a page [s]."""
FLAGS = (
    '--headless', '--disable-gpu', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader', '--disable-background-networking', '--hide-scrollbars',
    '--disable-dev-shm-usage', '--no-first-run',
)

NO_SANDBOX = '--no-sandbox'
NOBODY = 'nobody'
"""Unprivileged user that runs the browser if root starts it."""


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
    Take a screenshot of the top of a page once it is fully drawn.

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
        The browser did not show the page.

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
        The browser did not print the page.

    """
    _run(page, path, '--no-pdf-header-footer', '--virtual-time-budget=20000',
         f'--print-to-pdf={path.absolute()}')


def _run(page: Path, path: Path, *arguments: str) -> None:
    """
    Run the browser on a page, with a temporary profile and minimal rights.

    It runs in its sandbox.  Chromium refuses the sandbox as root, so root runs it as an
    unprivileged user on a copy of the page, because that user cannot read root's files.
    """
    as_root = os.geteuid() == 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as room:
        shown, made = page.absolute(), path.absolute()
        options: dict[str, Any] = {}
        if as_root:
            shown, made, options = _hand_over(Path(room), shown, made)
        given = [item.replace(str(path.absolute()), str(made)) for item in arguments]
        command = [
            find_browser(), *FLAGS, *([NO_SANDBOX] if as_root else []),
            f'--user-data-dir={room}/profile', *given, shown.as_uri(),
        ]
        try:
            done = subprocess.run(
                command, capture_output=True, timeout=TIMEOUT, check=False, **options
            )
        except subprocess.TimeoutExpired as error:
            raise DataError(f'{page.name} was not drawn within {TIMEOUT:g} s') from error
        drawn = not done.returncode and made.exists() and made.stat().st_size > 0
        if drawn and made != path.absolute():
            shutil.copyfile(made, path)
    if not drawn:
        text = done.stderr.decode('utf-8', 'replace').strip().splitlines()
        raise DataError(f'{page.name} was not drawn: {text[-1] if text else done.returncode}')


def _hand_over(room: Path, page: Path, path: Path) -> tuple[Path, Path, dict[str, Any]]:
    """Copy a page into a folder of NOBODY; return page, output file and process options."""
    try:
        user = pwd.getpwnam(NOBODY)
    except KeyError as error:
        raise ConfigError(
            f'root prints as the user {NOBODY}, and there is none: print as another user'
        ) from error
    copy, made = room / page.name, room / f'drawn{path.suffix}'
    shutil.copyfile(page, copy)
    (room / 'profile').mkdir()
    for item in (room, copy, room / 'profile'):
        os.chown(item, user.pw_uid, user.pw_gid)
    return copy, made, {
        'user': user.pw_uid, 'group': user.pw_gid, 'extra_groups': [],
        'env': {'PATH': os.environ.get('PATH', os.defpath), 'HOME': str(room)}, 'cwd': room,
    }
