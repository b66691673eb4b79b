# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Damages inputs of the readers with atheris (libFuzzer), guided by the code that they reach.

``python tools/fuzz.py [TARGET ...] [--seconds N]`` runs each target in a process of its own,
within 2 GB and 10 s an input, from the corpus in ``tools/corpus``.  What is found is left in
``build/fuzz``.
"""

import argparse
import os
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
GUIDED = ['plc_inspect', 'plyfile', 'laspy', 'mcap', 'rosbags', 'yaml']
"""Packages whose branches guide the search."""


def list_compiled() -> list[str]:
    """Return the modules that hold kernels: numba cannot compile what is traced."""
    return [
        '.'.join(path.relative_to(ROOT).with_suffix('').parts)
        for path in (ROOT / 'plc_inspect').rglob('*.py')
        if 'njit' in path.read_text(encoding='utf-8')
    ]


def run(name: str, seconds: int) -> None:
    """Fuzz one target in this process, which ends with it."""
    import atheris

    with atheris.instrument_imports(include=GUIDED, exclude=list_compiled()):
        from tools.fuzz_targets import run_target

    def take(data: bytes) -> None:
        run_target(name, data)

    for seed in (ROOT / 'tools' / 'corpus' / name).iterdir():
        take(seed.read_bytes())  # kernels are compiled before the time of an input counts
    found = ROOT / 'build' / 'fuzz' / name
    found.mkdir(parents=True, exist_ok=True)
    atheris.Setup([
        'fuzz', f'-max_total_time={seconds}', '-rss_limit_mb=2048', '-timeout=10',
        '-max_len=20000', f'-artifact_prefix={found}/', '-print_final_stats=1', '-verbosity=0',
        str(found), str(ROOT / 'tools' / 'corpus' / name),
    ], take)
    atheris.Fuzz()


def main() -> int:
    """Fuzz all targets, or some, one after the other."""
    from tools.fuzz_targets import TARGETS

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('targets', nargs='*', metavar='TARGET', help=f'of {", ".join(TARGETS)}')
    parser.add_argument('--seconds', type=int, default=60, help='for each target')
    arguments = parser.parse_args()
    failed = []
    for name in arguments.targets or TARGETS:
        if name not in TARGETS:
            parser.error(f'no target {name}; there are {", ".join(TARGETS)}')
        done = subprocess.run(
            [sys.executable, __file__], env=os.environ | {
                'PLC_FUZZ': f'{name} {arguments.seconds}', 'PYTHONPATH': str(ROOT),
            }, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        counts = [line.split()[1] for line in done.stdout.splitlines()
                  if line.startswith('stat::number_of_executed_units')]
        print(f'{name}: {counts[0] if counts else "?"} inputs, exit {done.returncode}', flush=True)
        if done.returncode:
            failed.append(name)
            print('\n'.join(done.stdout.splitlines()[-40:]))
    return len(failed) > 0


if __name__ == '__main__':
    if 'PLC_FUZZ' in os.environ:
        chosen, limit = os.environ['PLC_FUZZ'].split()
        run(chosen, int(limit))
    sys.exit(main())
