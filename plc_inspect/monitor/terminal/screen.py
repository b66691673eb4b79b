# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The terminal screen, redrawn twice a second."""

import sys
from types import TracebackType

from rich.console import Console
from rich.live import Live

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.picture.picture import Picture
from plc_inspect.monitor.terminal.text import draw

NARROWEST, LOWEST = 60, 20


class Screen:
    """
    The whole terminal; closing restores what it showed before.

    Parameters
    ----------
    name : str
        Name of the node.

    Raises
    ------
    ConfigError
        Standard output is not a terminal.

    """

    def __init__(self, name: str) -> None:
        if not sys.stdout.isatty():
            raise ConfigError('standard output is not a terminal: use --once or --json')
        self._name = name
        self._console = Console(highlight=False)
        self._live = Live(
            console=self._console, screen=True, auto_refresh=False, redirect_stdout=False,
            redirect_stderr=False,
        )

    def __enter__(self) -> 'Screen':
        """Switch to the full screen."""
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the terminal."""
        self._live.stop()

    def show(self, picture: Picture) -> None:
        """Draw a picture in the current size of the terminal."""
        width, height = self._console.size
        if width < NARROWEST or height < LOWEST:
            self._live.update(
                f'the terminal has {width} x {height} characters, {NARROWEST} x {LOWEST} are '
                'needed', refresh=True,
            )
            return
        self._live.update(draw(picture, width, height, self._name), refresh=True)
