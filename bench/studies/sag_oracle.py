# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compares the change of state with mechaphlowers (RTE) on random spans.

mechaphlowers pins numpy, so it runs in an environment of its own: one that is given with
``--oracle``, or one that is made in a temporary folder.
"""

import argparse
import json
from pathlib import Path
import subprocess
import sys
import tempfile

import numpy as np

from plc_inspect.core.loads.sag_tension import AIR_DENSITY, Case, change_state, DRAG
from plc_inspect.offline.readers.catalogue import load_conductor

ORACLE = """
import json, sys
import numpy as np
from mechaphlowers.core.models.balance.solvers.find_parameter_solver import (
    FindParamModel, FindParamSolverForLoop,
)
from mechaphlowers.core.models.cable.deformation import DeformationRte
from mechaphlowers.core.models.cable.span import CatenarySpan
from mechaphlowers.core.models.external_loads import CableLoads
from numpy.polynomial import Polynomial

result = []
for row in json.load(sys.stdin):
    # twice, as the solver leaves the last element out of its stop condition
    one = lambda name: np.array([float(row[name])] * 2)
    weight, area = np.float64(row['weight']), np.float64(1e-3)
    def deform(span, temperature):
        return DeformationRte(
            tension_mean=span.T_mean(), cable_length=span.L, cable_section_area=area,
            linear_weight=weight, young_modulus=np.float64(row['stiffness'] / area),
            dilatation_coefficient=np.float64(row['expansion']),
            temperature_reference=np.float64(15.0), polynomial_conductor=Polynomial([0.0, 1.0]),
            sagging_temperature=temperature,
        )
    span = CatenarySpan(one('length'), one('rise'), one('c'), linear_weight=weight)
    free = deform(span, one('surveyed')).L_0()
    loads = CableLoads(
        cable_section_area=area, diameter=np.float64(row['diameter']), linear_weight=weight,
        ice_thickness=one('ice'), wind_pressure=one('pressure'),
    )
    swing = loads.load_angle
    length = np.sqrt(one('length')**2 + (one('rise') * np.sin(swing))**2)
    moved = CatenarySpan(length, one('rise') * np.cos(swing), one('c'),
                         load_coefficient=loads.load_coefficient, linear_weight=weight)
    model = FindParamModel(moved, deform(moved, one('temperature')))
    model.set_attributes(one('c'), free)
    try:
        found = FindParamSolverForLoop(model, stop_condition=1e-6, max_iter=200).find_parameter()
        solved = found[0] > 0 and abs(model._delta(found)[0]) < 1e-9
    except Exception:
        solved = False
    if not solved:  # its Newton steps leave the range of the catenary on a few spans
        result.append(None)
        continue
    moved.set_parameter(found)
    result.append({'c': float(found[0]), 'sag': float(moved.sag()[0]), 'swing': float(swing[0])})
json.dump(result, sys.stdout)
"""


def draw_spans(num, seed):
    """Draw random spans with a conductor and a case each."""
    rng = np.random.default_rng(seed)
    names = ('ACSR 94-AL1/15-ST1A', 'ACSR 122-AL1/20-ST1A', 'ACSR Drake', 'AAAC Anaheim')
    rows = []
    for _ in range(num):
        length = rng.uniform(60.0, 450.0)
        rows.append({
            'conductor': names[rng.integers(len(names))],
            'length': length,
            'rise': rng.uniform(-0.25, 0.25) * length,
            'c': rng.uniform(500.0, 1800.0),
            'surveyed': rng.uniform(-5.0, 30.0),
            'temperature': rng.uniform(-20.0, 90.0),
            'ice': float(rng.choice([0.0, 0.01, 0.02])),
            'wind': float(rng.choice([0.0, 12.0, 25.0])),
        })
    return rows


def ask_oracle(python, rows):
    """Return what mechaphlowers says of the spans."""
    full = []
    for row in rows:
        conductor = load_conductor(row['conductor'])
        full.append(row | {
            'weight': conductor.weight, 'stiffness': conductor.stiffness,
            'expansion': conductor.expansion, 'diameter': conductor.diameter,
            'pressure': 0.5 * AIR_DENSITY * DRAG * row['wind'] ** 2,
        })
    done = subprocess.run([python, '-c', ORACLE], input=json.dumps(full), text=True, check=True,
                          capture_output=True)
    return json.loads(done.stdout)


def main():
    """Print the table; exit 1 where a sag differs by more than the limit."""
    parser = argparse.ArgumentParser(description='Compares sags with mechaphlowers.')
    parser.add_argument('--oracle', metavar='PYTHON', help='interpreter that has mechaphlowers')
    parser.add_argument('--num', type=int, default=10)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--limit', type=float, default=0.02, help='greatest difference [m]')
    arguments = parser.parse_args()
    rows = draw_spans(arguments.num, arguments.seed)
    with tempfile.TemporaryDirectory() as room:
        python = arguments.oracle
        if python is None:
            subprocess.run([sys.executable, '-m', 'venv', room], check=True)
            python = str(Path(room, 'bin', 'python'))
            pip = [python, '-m', 'pip', 'install', '--quiet', 'mechaphlowers']
            subprocess.run(pip, check=True)
        expected = ask_oracle(python, rows)
    print('| conductor | span [m] | rise [m] | c [m] | from [C] | to [C] | ice [mm] | wind [m/s] |'
          ' sag [m] | mechaphlowers [m] | difference [mm] |')
    print('|' + ' --- |' * 11)
    worst = 0.0
    for row, other in zip(rows, expected, strict=True):
        if other is None:
            continue
        case = Case(name='', temperature=row['temperature'], ice=row['ice'], wind=row['wind'])
        state = change_state(row['length'], row['rise'], row['c'], row['surveyed'],
                             load_conductor(row['conductor']), case)
        difference = state.sag - other['sag']
        worst = max(worst, abs(difference))
        print(f'| {row["conductor"]} | {row["length"]:.1f} | {row["rise"]:.1f} | {row["c"]:.0f} |'
              f' {row["surveyed"]:.0f} | {row["temperature"]:.0f} | {1000 * row["ice"]:.0f} |'
              f' {row["wind"]:.0f} | {state.sag:.3f} | {other["sag"]:.3f} |'
              f' {1000 * difference:.2f} |')
    solved = sum(other is not None for other in expected)
    print(f'\n{solved} of {len(rows)} spans solved by mechaphlowers')
    print(f'greatest difference {1000 * worst:.2f} mm, limit {1000 * arguments.limit:.0f} mm')
    return 1 if worst > arguments.limit else 0


if __name__ == '__main__':
    sys.exit(main())
