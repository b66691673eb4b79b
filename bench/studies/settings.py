# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Each setting that decides what a line is, a fifth less and more, over all real clouds.

A default that is fitted to the clouds at hand loses much when it moves.  No setting may lower the
mean wire F1 by more than ``MOST_LOSS``, nor bring lines to a cloud that has none.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table
from frames import Cloud, read, REAL, score
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.tuning.parameters import get_value
from plc_inspect.offline.commands.sensitivity import change, list_names
from plc_inspect.setting_names import update

MOST_LOSS = 0.03
"""Of the mean wire F1."""
COLUMNS = ('setting', 'from', 'to', 'mean F1', 'change', 'worst change', 'of', 'invented')


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one set of settings gave."""

    f1: tuple[float, ...]
    """Of each cloud with lines."""
    num_invented: int
    """Lines on clouds without."""


def run_all(clouds: Sequence[Cloud], settings: Settings) -> Outcome:
    """Run all clouds with the same settings."""
    pipeline = Pipeline(settings)
    scores = [score(cloud, pipeline.run(cloud.points), 0.0) for cloud in clouds]
    pairs = list(zip(clouds, scores, strict=True))
    return Outcome(
        f1=tuple(item.f1 for cloud, item in pairs if cloud.is_labelled),
        num_invented=sum(
            item.num_lines for cloud, item in pairs
            if not cloud.is_labelled and 'no_wires' in cloud.name
        ),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Move one setting after the other and print a row for each; 1 where one loses too much."""
    parser = argparse.ArgumentParser(description='Each setting a fifth less and more.')
    parser.add_argument('--real', type=Path, default=REAL, metavar='DIR')
    parser.add_argument('--only', nargs='*', default=[''], metavar='PART',
                        help='settings with one of these in their names')
    arguments = parser.parse_args(argv)
    paths = sorted(arguments.real.glob('*.laz'))
    if not paths:
        parser.error(f'{arguments.real} holds no cloud')
    clouds = [read(path) for path in paths]
    names = [cloud.name for cloud in clouds if cloud.is_labelled]
    settings = Settings()
    base = run_all(clouds, settings)
    print(f'mean F1 of {len(names)} clouds {np.mean(base.f1):.4f}, '
          f'{base.num_invented} lines invented on {len(clouds) - len(names)}', flush=True)
    rows, bad = [], []
    for name in list_names():
        if not any(part in name for part in arguments.only):
            continue
        for to in change(settings, name):
            own = run_all(clouds, update(settings, {name: to}))
            moved = np.subtract(own.f1, base.f1)
            rows.append((
                name, f'{get_value(settings, name):g}', f'{to:g}', f'{np.mean(own.f1):.4f}',
                f'{moved.mean():+.4f}', f'{moved.min():+.4f}', names[int(moved.argmin())],
                f'{own.num_invented}',
            ))
            print(' | '.join(rows[-1]), flush=True)
            if moved.mean() < -MOST_LOSS or own.num_invented > base.num_invented:
                bad.append(f'{name} {to:g}')
    print(render_table(COLUMNS, sorted(rows, key=lambda row: float(row[4]))))
    print(f'{len(rows) - len(bad)} of {len(rows)} changes hold' + ''.join(
        f'; {item} does not' for item in bad
    ))
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
