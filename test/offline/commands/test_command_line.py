# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the command lines share."""

import sys

import pytest

from plc_inspect.offline.commands.command_line import run_command, show_progress


@pytest.mark.parametrize('name', ['stdout', 'stderr'])
def test_a_closed_stream_is_no_defect(name, monkeypatch):
    """Python has None in its place, as for a daemon that closes them."""
    def body():
        print('done')
        with show_progress(quiet=False) as progress:
            progress('reading', 0.5)
        return 0

    monkeypatch.setattr(sys, name, None)
    assert run_command('plc_survey', body) == 0
