# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import csv
import dataclasses
import os
from pathlib import Path

from factories import make_inspection
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.command_line import run_command
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.printable import (
    check_name,
    decode_name,
    make_cell,
    make_one_line,
    make_printable,
)
from plc_inspect.stream.frame import BodyReader, put_text


def test_control_characters_are_written_out():
    text = 'odom\x1b]0;title\x07\x9b31m \u202eabc\ttab\nline \u00e9'
    assert make_printable(text) == (
        'odom\\x1b]0;title\\x07\\x9b31m \\u202eabc\ttab\nline \u00e9'
    )
    assert make_one_line(' a\n\tb\x1bc ') == 'a b\\x1bc'


def test_bytes_of_names_that_are_not_utf8_are_written_out():
    name = os.fsdecode(b'n\xff\xc3\xa4.las')
    assert make_printable(name) == 'n\\udcff\u00e4.las'
    assert decode_name(name) == 'n\ufffd\u00e4.las'
    assert decode_name('\u00e4.las') == '\u00e4.las'
    check_name(Path('\u00e4.las'))
    with pytest.raises(DataError, match='its name is not UTF-8, as names in the ledger are: ren'):
        check_name(Path(name) / 'a.las')


def test_errors_reach_the_terminal_without_sequences(capsys):
    def fail():
        raise DataError('field \x1b[2J\x1b]52;c;YQ==\x07 is missing\nnow')

    assert run_command('plc_survey', fail) == 2
    err = capsys.readouterr().err
    assert '\x1b' not in err
    assert err == 'plc_survey: field \\x1b[2J\\x1b]52;c;YQ==\\x07 is missing now\n'


def test_texts_of_the_stream_are_clean():
    assert BodyReader(put_text('map\x1b[31m')).take_text() == 'map\\x1b[31m'


@pytest.mark.parametrize('start', ['=', '+', '-', '@', '\t', '\r'])
def test_no_cell_is_a_formula(start):
    assert make_cell(f'{start}cmd()') == f"'{start}cmd()"
    assert make_cell(f'a{start}') == f'a{start}'


def test_no_cell_of_the_tables_is_a_formula(tmp_path):
    inspection = make_inspection(num_ground=50)
    hazards = tuple(
        dataclasses.replace(item, rule='=HYPERLINK("http://x")', source='@SUM(A1)')
        for item in inspection.result.hazards
    )
    assert hazards
    result = dataclasses.replace(inspection.result, hazards=hazards)
    write_results(tmp_path / 'out', dataclasses.replace(inspection, result=result))
    with (tmp_path / 'out/hazards.csv').open(encoding='utf-8', newline='') as stream:
        rows = list(csv.DictReader(stream))
    assert {row['rule'] for row in rows} == {'\'=HYPERLINK("http://x")'}
    assert {row['source'] for row in rows} == {"'@SUM(A1)"}
    assert all(float(row['position_x [m]']) is not None for row in rows)  # numbers stay numbers
