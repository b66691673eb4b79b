# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of faults done to the node: which rows end it with 1."""

import importlib
from pathlib import Path
import sys

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / 'bench'))
bench = importlib.import_module('faults')
sys.path.pop(0)


def make(share=1.0, ghosts=0, critical=1):
    return bench.Outcome(spans=7, share=share, ghosts=ghosts, hazards=2, critical=critical)


@pytest.mark.parametrize(('outcome', 'code', 'said', 'right'), [
    (make(), 0, '', True),
    (make(ghosts=1), 0, 'WARN', False),
    (make(critical=2), 0, 'WARN', False),
    (make(share=0.6), 0, 'WARN', True),
    (make(share=0.6), 0, '', False),
    (make(critical=0, share=0.0), 1, 'ERROR', True),
    (None, 1, 'ERROR', True),
    (None, 0, 'ERROR', False),
    (None, 1, '', False),
])
def test_a_row_is_right_or_says_what_it_lacks(outcome, code, said, right):
    assert bench.is_right(outcome, 1, code, said) == right


@pytest.mark.parametrize(('found', 'code'), [((1.0, 0), 0), ((0.5, 0), 1), ((1.0, 2), 1)])
def test_a_row_that_is_wrong_ends_the_bench_with_1(monkeypatch, tmp_path, capsys, found, code):
    outcomes = iter([make(), make(share=found[0], ghosts=found[1])])
    (tmp_path / 'spans.json').write_text('{"spans": [{}]}', encoding='utf-8')
    monkeypatch.setattr(sys, 'argv', ['faults', 'SIGHUP'])
    monkeypatch.setattr(bench, 'prepare_transport', lambda: None)
    monkeypatch.setattr(bench, 'read_flight', lambda seconds: [])
    monkeypatch.setattr(bench, 'fly', lambda *rest: [str(tmp_path), 'exit 0', ''])
    monkeypatch.setattr(bench, 'compare', lambda *rest: next(outcomes))
    assert bench.main() == code
    assert ('1 of 2' in capsys.readouterr().out) == bool(code)
