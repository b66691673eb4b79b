# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The newest run seen of each vehicle: messages that repeat an earlier run are refused."""

import json

from plc_inspect.errors import PlcInspectError
from plc_inspect.monitor.picture.admission import Admission
from plc_inspect.security.member_keys import find_keys, state_folder
from plc_inspect.whole_files import replace_file

FILE = 'seen_runs.json'
MOST_SIGNERS = 1000
"""Most vehicles in the file, which bounds its size."""


class SeenRuns:
    """
    The admission of a monitor with the keys of this machine, and the runs that it remembers.

    Raises
    ------
    ConfigError
        PLC_KEYS names keys that cannot be read.

    """

    def __init__(self) -> None:
        keys = find_keys()
        self.keys = keys is not None
        """Whether this machine has keys, so that the graph is reached over TCP."""
        self._path = None if keys is None else state_folder() / FILE
        self._saved = self._load()
        self.admission = Admission(
            None if keys is None else keys.make_verifier(), dict(self._saved)
        )

    def save(self) -> None:
        """Save new runs; if that fails, the next monitor does not know them."""
        runs = self.admission.runs
        if self._path is None or runs == self._saved:
            return
        self._saved = dict(runs)
        known = self._load()  # another monitor of this machine writes to it too
        for signer, run in runs.items():
            known[signer] = max(run, known.get(signer, run))
        newest = dict(sorted(known.items(), key=lambda item: item[1])[-MOST_SIGNERS:])
        try:
            with replace_file(self._path) as aside:
                aside.write_text(json.dumps(newest) + '\n', encoding='ascii')
        except PlcInspectError:
            self._path = None

    def _load(self) -> dict[str, int]:
        if self._path is None:
            return {}
        try:
            values = json.loads(self._path.read_text(encoding='ascii'))
            return {str(name): int(run) for name, run in values.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}
