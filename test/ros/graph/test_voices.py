# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is handed on to log with is a voice."""

from pathlib import Path
import re

from rclpy.logging import get_logger

import plc_inspect
from plc_inspect.ros.graph.voices import Voices


def test_voices_may_take_turns_in_one_line_of_code(capfd):
    log = Voices(get_logger('test_voices'))
    for voice in (log.info, log.warning, log.error, log.info):
        voice('text')
    lines = capfd.readouterr().err.splitlines()
    assert [re.findall('INFO|WARN|ERROR', line)[0] for line in lines] == [
        'INFO', 'WARN', 'ERROR', 'INFO',
    ]


def test_no_function_of_a_logger_is_handed_on():
    bare = re.compile(r'get_logger\(\)(\.(info|warning|error)(?!\()|(?![.)]))')
    for file in Path(plc_inspect.__file__).parent.rglob('*.py'):
        assert not bare.findall(file.read_text()), file
