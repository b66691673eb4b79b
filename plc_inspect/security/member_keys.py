# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The keys of programs on this machine: the member folder that PLC_KEYS names."""

import contextlib
from dataclasses import dataclass
from datetime import datetime, UTC
import os
from pathlib import Path
import time

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.security.authority import read_end
from plc_inspect.shared_files import find_home
from plc_inspect.stream.signature import Signer, Verifier
from plc_inspect.whole_files import replace_file

VARIABLE = 'PLC_KEYS'
PROFILE = 'fastdds.xml'


def state_folder() -> Path:
    """Return, and create, the folder of state kept between runs, below ROS_HOME (~/.ros)."""
    folder = find_home()
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@dataclass(frozen=True, slots=True)
class MemberKeys:
    """The folder of one member, as ``plc_keys`` made it."""

    folder: Path

    @property
    def profile(self) -> Path | None:
        """Its Fast DDS profile, None if SROS2 takes its place."""
        path = self.folder / PROFILE
        return path if path.is_file() else None

    def days_left(self) -> int:
        """
        Return for how many days its certificates are still valid, negative if expired.

        Raises
        ------
        ConfigError
            They cannot be read.

        """
        end = read_end(self._read('member.crt'))
        return (end - datetime.now(UTC)).days

    def make_signer(self) -> Signer | None:
        """
        Return the signer of a vehicle's stream, with a run number above all before.

        Raises
        ------
        ConfigError
            The key cannot be read.

        """
        if not (self.folder / 'stream.key').exists():
            return None
        return Signer(self._read('stream.key'), _next_run())

    def make_verifier(self) -> Verifier:
        """
        Return the verifier of the stream.

        Raises
        ------
        ConfigError
            The keys cannot be read.

        """
        return Verifier(self._read('stream.pub'))

    def _read(self, name: str) -> bytes:
        path = self.folder / name
        try:
            return path.read_bytes()
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise ConfigError(f'{VARIABLE}: {path} cannot be read: {reason}') from error


def find_keys() -> MemberKeys | None:
    """
    Return the keys that PLC_KEYS names, None if it is not set.

    Raises
    ------
    ConfigError
        It does not name a folder that ``plc_keys`` made.

    """
    text = os.environ.get(VARIABLE, '')
    if not text:
        return None
    folder = Path(text).expanduser().absolute()
    if not (folder / 'member.crt').is_file():
        raise ConfigError(f'{VARIABLE}: {folder} is not a folder of a member (docs/security.md)')
    return MemberKeys(folder)


def _next_run() -> int:
    """Return a run number above all before: the time, or the last one plus 1."""
    now = int(time.time())
    with contextlib.suppress(OSError, DataError):  # a full disk keeps nobody from flying
        path = state_folder() / 'run_number'
        last = path.read_text(encoding='ascii').strip() if path.exists() else ''
        now = max(now, int(last) + 1 if last.isdecimal() and last.isascii() else 0)
        with replace_file(path) as aside:
            aside.write_text(f'{now}\n', encoding='ascii')
    return now
