# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How far a constant of the core can be moved before a result gets worse.

Each constant of the modules asked for is put at other values, by the factors below, and all clouds
are run again.  A constant holds where no cloud loses more than ``MOST_LOSS`` of wire F1, a
conductor-span, a support or ``MOST_SHIFT`` of median position, and none gains a false one.  The
clouds are simulated maps of a seed that no floor is judged on, and real ones where they are; what
they never ask for holds as well.  Kernels that know the constant are compiled anew, with all that
call them.
"""

import argparse
import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import importlib
import math
from pathlib import Path
import pkgutil
import re
import sys
from types import CodeType, ModuleType
from typing import Any

from accuracy import REAL, Run, run_real, run_survey
from common.surveys import make_map, open_cache
from numba.core.caching import NullCache
from numba.core.registry import CPUDispatcher
import numpy as np

import plc_inspect.core
from plc_inspect.core.pipeline import Pipeline

SCENES = ('low_voltage', 'crossing', 'town')
DENSITY = 5.0
SEED = 7
CLOUDS = ('oakland_part3_an', 'oakland_part2_ai', 'oakland_part2_ad')
UNLABELLED = ('oakland_part2_ad',)
FAR, NEAR = (0.5, 2.0), (0.7, 1.4)
"""Factors that are tried first, and those that are tried where the first one does not hold."""
MOST_LOSS = 0.005
"""Of wire F1."""
MOST_SHIFT = 0.01
"""Of the median vertical error, sag error and support position [m]."""
_NAMES = re.compile(r'^(_?[A-Z][A-Z0-9_]*(?:, _?[A-Z][A-Z0-9_]*)*)(?:: \w+)? = ', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Figures:
    """What is judged of one cloud."""

    f1: float
    """NaN where there are no wires."""
    found: tuple[int, int]
    """Conductor-spans and supports that were found."""
    false: tuple[int, int]
    """And false ones; of a cloud without truth about them, all conductor-spans."""
    errors: tuple[float, ...]
    """Medians [m]."""


def judge(run: Run) -> Figures:
    """Return the figures of a run."""
    scores = run.scores
    if scores is None or scores.only_labels:
        f1 = scores.wire.f1 if scores is not None and scores.wire else math.nan
        num = len(run.result.spans)
        return Figures(f1, (0, 0), (0 if run.has_line else num, 0), ())
    return Figures(
        scores.wire.f1 if scores.wire else math.nan,
        (scores.spans.found, scores.supports.found),
        (scores.spans.false, scores.supports.false),
        tuple(item.median for item in (
            scores.vertical_rmse, scores.sag, scores.support_position)),
    )


def find_harm(before: Figures, after: Figures) -> str:
    """Return what is worse after than before, or an empty string."""
    if before.f1 - after.f1 > MOST_LOSS or (math.isnan(after.f1) and not math.isnan(before.f1)):
        return f'wire F1 {before.f1:.4f} to {after.f1:.4f}'
    for what, old, new in zip(('spans', 'supports'), before.found, after.found, strict=True):
        if new < old:
            return f'{what} {old} to {new}'
    for what, old, new in zip(('spans', 'supports'), before.false, after.false, strict=True):
        if new > old:
            return f'false {what} {old} to {new}'
    for old, new in zip(before.errors, after.errors, strict=True):
        if new - old > MOST_SHIFT:
            return f'median error {old:.3f} to {new:.3f} m'
    return ''


def run_clouds(surveys: Sequence[Any], real: Path) -> Iterator[tuple[str, Figures]]:
    """Yield name and figures of each cloud."""
    for survey in surveys:
        yield survey.name, judge(run_survey(survey, 'map', DENSITY, SEED))
    for name in CLOUDS:
        path = real / f'{name}.laz'
        if path.is_file():
            yield name, judge(run_real(path, name not in UNLABELLED))


def list_constants(module: ModuleType) -> Iterator[str]:
    """Yield the names of the numbers at the top of a module, and of tuples of them."""
    for names in _NAMES.findall(_read(module)):
        for name in names.split(', '):
            value = getattr(module, name)
            parts = value if isinstance(value, tuple) else (value,)
            if parts and all(type(part) in (int, float) for part in parts):
                yield name


def scale(value: Any, factor: float) -> Any:
    """Return a value at a multiple; a whole number stays whole."""
    if isinstance(value, tuple):
        return tuple(scale(part, factor) for part in value)
    if isinstance(value, int):
        return max(math.floor(value * factor) if factor < 1 else math.ceil(value * factor), 0)
    return value * factor


def walk_modules() -> list[ModuleType]:
    """Return all modules of the core."""
    found = pkgutil.walk_packages(plc_inspect.core.__path__, 'plc_inspect.core.')
    return [importlib.import_module(item.name) for item in found]


def find_holders(owner: ModuleType, name: str, modules: Sequence[ModuleType]) -> list[ModuleType]:
    """Return the modules that know a constant by its name: its own and those that import it."""
    holders = [owner]
    for module in modules:
        for node in ast.walk(ast.parse(_read(module))):
            if isinstance(node, ast.ImportFrom) and node.module == owner.__name__ and any(
                item.name == name and item.asname is None for item in node.names
            ):
                holders.append(module)
    return holders


def find_kernels(
    name: str, holders: Sequence[ModuleType], modules: Sequence[ModuleType]
) -> list[Any]:
    """Return the kernels that know a constant, and all that call them."""
    kernels = {id(item): item for module in modules for item in vars(module).values()
               if isinstance(item, CPUDispatcher)}
    own = {module.__name__ for module in holders}
    found = {key for key, item in kernels.items()
             if item.py_func.__module__ in own and name in _list_names(item.py_func.__code__)}
    while True:
        more = {
            key for key, item in kernels.items() if key not in found and any(
                id(item.py_func.__globals__.get(called)) in found
                for called in _list_names(item.py_func.__code__)
            )
        }
        if not more:
            return [kernels[key] for key in found]
        found |= more


def _read(module: ModuleType) -> str:
    """Return the source code of a module."""
    return Path(module.__file__ or '').read_text(encoding='utf-8')


def _list_names(code: CodeType) -> set[str]:
    """Return the global names that a function reads, with those of the functions in it."""
    names = set(code.co_names)
    for item in code.co_consts:
        if isinstance(item, CodeType):
            names |= _list_names(item)
    return names


class Moved:
    """A constant at another value for as long as this is entered."""

    def __init__(self, owner: ModuleType, name: str, modules: Sequence[ModuleType]) -> None:
        self.name, self.value = name, getattr(owner, name)
        self.holders = find_holders(owner, name, modules)
        self.kernels = find_kernels(name, self.holders, modules)

    def put(self, value: Any, caches: Sequence[Any]) -> None:
        """Set the value, and let the kernels be compiled or loaded anew."""
        for module in self.holders:
            setattr(module, self.name, value)
        for kernel, cache in zip(self.kernels, caches, strict=True):
            kernel._reset_overloads()
            kernel._cache = cache

    def run(self, value: Any, surveys: Sequence[Any], real: Path) -> dict[str, Figures] | str:
        """Return the figures of all clouds, or the error, at a value."""
        caches = [kernel._cache for kernel in self.kernels]
        self.put(value, [NullCache()] * len(caches))
        try:
            return dict(run_clouds(surveys, real))
        except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
            return f'{type(error).__name__}: {error}'
        finally:
            self.put(self.value, caches)


def explore(
    moved: Moved, usual: dict[str, Figures], surveys: Sequence[Any], real: Path
) -> Iterator[tuple[Any, str]]:
    """Yield the values that were tried, each with the harm that it did."""
    for far, near in zip(FAR, NEAR, strict=True):
        for factor in (far, near):
            value = scale(moved.value, factor)
            if value == moved.value:
                continue
            after = moved.run(value, surveys, real)
            harm = after if isinstance(after, str) else next(
                (f'{name}: {worse}' for name, figures in after.items()
                 if (worse := find_harm(usual[name], figures))), '')
            yield value, harm
            if not harm:
                break


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description='How far constants of the core can be moved.')
    parser.add_argument('modules', nargs='+', help='below plc_inspect.core, such as spans.joints')
    parser.add_argument('--names', nargs='+', help='only these constants')
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated surveys here')
    parser.add_argument('--real', type=Path, metavar='DIR', default=REAL)
    arguments = parser.parse_args(argv)
    modules = walk_modules()
    with open_cache(arguments.cache) as cache:
        surveys = [make_map(cache, name, density=DENSITY, seed=SEED) for name in SCENES]
    Pipeline().run(surveys[0].points)
    usual = dict(run_clouds(surveys, arguments.real))
    for name, figures in usual.items():
        print(f'{name}: {figures}', flush=True)
    for asked in arguments.modules:
        owner = importlib.import_module(f'plc_inspect.core.{asked}')
        for name in list_constants(owner):
            if arguments.names and name not in arguments.names:
                continue
            moved = Moved(owner, name, modules)
            tried = [f'{value!r} {harm or "holds"}'
                     for value, harm in explore(moved, usual, surveys, arguments.real)]
            print(f'{asked} {name} = {moved.value!r}: ' + '; '.join(tried), flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
