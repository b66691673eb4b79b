# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the command lines share: arguments, one-line errors, exit codes, progress."""

import argparse
import atexit
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import gc
import math
import os
from pathlib import Path
import signal
import sys
import threading
from types import FrameType
from typing import Any, NoReturn

from plc_inspect.errors import explain_missing, PlcInspectError
from plc_inspect.interrupts import interruptible
from plc_inspect.printable import make_one_line

DONE, DEFECT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

COLLECT_AFTER = 100_000
"""New objects between garbage collections: loading a command creates many that all stay."""
atexit.register(gc.freeze)  # no collection over all objects at exit

Progress = Callable[[str, float], None]
"""Called with the name of the step and its share, 0 to 1."""


class Parser(argparse.ArgumentParser):
    """An argument parser with error messages of one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with 2."""
        self.exit(BAD_INPUT, f'{self.prog}: {message} (see {self.prog} --help)\n')


def positive(text: str) -> float:
    """Read a number above 0, as the type of an argument."""
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a positive number')
    return value


def parse_with_ros(
    parser: argparse.ArgumentParser, argv: Sequence[str] | None
) -> argparse.Namespace:
    """Parse arguments, those of the process by default; ``ros`` are those after --ros-args."""
    items = list(sys.argv[1:] if argv is None else argv)
    ros: list[str] = []
    if '--ros-args' in items:
        at = items.index('--ros-args')
        items, ros = items[:at], items[at + 1:]
    arguments = parser.parse_args(items)
    arguments.ros = ros
    return arguments


def make_parser(name: str, description: str) -> Parser:
    """Return a parser with the arguments that every command with a results folder has."""
    parser = Parser(prog=name, description=description)
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='OUT', help='results folder to write'
    )
    parser.add_argument(
        '--params', type=Path, metavar='FILE',
        help='settings from a YAML file, in the layout of ROS parameters or of plain sections',
    )
    parser.add_argument(
        '--set', action='append', default=[], metavar='SECTION.NAME=VALUE', dest='assignments',
        help='one setting; may be repeated, wins over --params',
    )
    parser.add_argument('--force', action='store_true', help='replace a results folder')
    more = parser.add_argument_group('results')
    more.add_argument(
        '--rules', metavar='NAME', help='clearance rules: plain, one of config/rules, or a file'
    )
    more.add_argument(
        '--voltage', type=float, metavar='KV', help='nominal voltage that the rules ask for'
    )
    more.add_argument('--baseline', type=Path, metavar='OUT', help='earlier results to compare')
    more.add_argument(
        '--case', action='append', default=[], metavar='[NAME:] temperature=C[,ice=M][,wind=M/S]',
        dest='cases', help='what-if: load of the conductors; may be repeated',
    )
    more.add_argument('--conductor', metavar='NAME', help='conductor of the line, for --case')
    more.add_argument(
        '--conductors', type=Path, metavar='FILE', help='table instead of config/conductors.yaml'
    )
    more.add_argument(
        '--surveyed-at', type=float, metavar='C',
        help='temperature of the conductors when they were surveyed, for --case',
    )
    more.add_argument(
        '--geo', action='store_true', help='fail where no GeoJSON, KML and GeoPackage is possible'
    )
    more.add_argument('--pdf', action='store_true', help='print the report with Chromium as well')
    more.add_argument(
        '--paper', default='A4', metavar='SIZE', help='of the PDF: A4 (default) or Letter'
    )
    parser.add_argument('--quiet', action='store_true', help='print errors only')
    return parser


def run_command(name: str, body: Callable[[], int]) -> int:
    """
    Run the body of a command and return its exit code.

    Errors that a user can mend end in one line on stderr and exit code 2; interruption ends
    quietly with 130, as a shell expects; anything else is a defect and keeps its traceback.

    Parameters
    ----------
    name : str
        The name of the command, in front of the error.
    body : callable
        Returns the exit code.

    Returns
    -------
    0, 2, 130 or what the body returned.

    """
    try:
        with interruptible(), _end_on_sigterm(), _collect_seldom():
            code = body()
            print(end='', flush=True)  # does nothing where stdout is closed
            return code
    except PlcInspectError as error:
        return _complain(name, str(error))
    except ModuleNotFoundError as error:
        return _complain(name, explain_missing(error))
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of stdout is gone: keep the flush at exit from failing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        where = f'{error.filename}: ' if error.filename else ''
        return _complain(name, f'{where}{error.strerror or type(error).__name__}')
    except MemoryError as error:
        return _complain(name, f'not enough memory: {error}' if str(error) else 'out of memory')


@contextmanager
def show_progress(quiet: bool, time_left: bool = False) -> Iterator[Progress]:
    """
    Yield a callable that draws a bar on stderr; it does nothing unless that is a terminal.

    The time that is left is shown on demand, where shares grow evenly.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda step, share: None
        return
    from tqdm import tqdm

    form = '{desc:<12} {percentage:3.0f}%|{bar}| {elapsed}'
    form += ', {remaining} left' if time_left else ''
    with tqdm(total=1.0, bar_format=form, leave=False, file=sys.stderr) as bar:

        def show(step: str, share: float) -> None:
            if bar.desc != step:
                bar.set_description_str(step, refresh=False)
            bar.n = min(max(share, 0.0), 1.0)
            bar.refresh()

        yield show


def _complain(name: str, text: str) -> int:
    print(f'{name}: {make_one_line(text)}', file=sys.stderr)
    return BAD_INPUT


@contextmanager
def _collect_seldom() -> Iterator[None]:
    """Collect garbage less often."""
    before = gc.get_threshold()
    gc.set_threshold(COLLECT_AFTER, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def _end_on_sigterm() -> Iterator[None]:
    """Let SIGTERM unwind the stack, so that partly written files are removed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    previous: Any = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)
