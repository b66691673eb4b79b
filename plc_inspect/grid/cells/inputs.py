# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The files that name the inputs of a grid: clouds, folders, patterns and tile indices."""

from collections.abc import Iterator, Sequence
import glob
import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import unquote
import warnings

from plc_inspect.errors import DataError
from plc_inspect.offline.export.file_names import FILES, LEDGER, POINTS
from plc_inspect.offline.readers.clouds import SUFFIXES
from plc_inspect.printable import check_name, make_one_line
from plc_inspect.whole_files import check_outside

INDEX_SUFFIXES = ('.geojson', '.json', '.vpc', '.gpkg', '.shp')
"""A tile index: GeoJSON, a virtual point cloud, GeoPackage, shapefile."""
TABLES = ('.csv',)
"""Skipped when a folder is searched: most hold something else than points."""
LOCATION_KEYS = ('location', 'path', 'file', 'filename', 'file_name', 'url', 'href')
"""Attributes of an index that hold the path of a tile, as PDAL, LAStools and lidR name it."""


def expand_inputs(items: Sequence[str], folder: Path | None = None) -> list[Path]:
    """
    Find the files that the arguments name.

    A search, of a folder or by a pattern, passes over hidden files and over results: what lies in
    ``folder``, or below a folder with a ledger, and files of a survey beside its ``run.json``.  A
    pattern that ends in ``points.laz`` asks for results, and finds all but those in ``folder``.

    Parameters
    ----------
    items : sequence of str
        Files, folders (searched at any depth), patterns, tile indices.
    folder : Path or None
        Results folder of the run.

    Returns
    -------
    list of Path
        Each once, also where links lead to one file: in the order of the arguments, and by name
        within each.

    Raises
    ------
    DataError
        There is no such file, or its name is not UTF-8; a folder, pattern or index holds no
        cloud; or a file that is named lies in ``folder``.

    """
    found: dict[Path, Path] = {}
    for item in items:
        search = _Search(folder)
        own = list(_expand(item, search))
        if not own and search.num_skipped:
            advice = f": name those as '{item}/**/{POINTS}'" if Path(item).is_dir() else ''
            raise DataError(f'{item} holds no cloud beside results of earlier runs{advice}')
        if not own:
            raise DataError(f'{item} holds no cloud: none ends in {", ".join(SUFFIXES)}')
        for path in own:
            check_name(path)
            found.setdefault(path.resolve(), path.parent.resolve() / path.name)
    if folder is not None:
        check_outside(list(found.values()), folder)
    return list(found.values())


class _Search:
    """Finds clouds below folders, but for those that earlier runs wrote."""

    def __init__(self, folder: Path | None) -> None:
        self._out = None if folder is None else folder.resolve()
        self._ledgers: dict[Path, bool] = {}
        self.num_skipped = 0
        """Folders and files passed over as results."""

    def find(self, folder: Path) -> Iterator[Path]:
        """Return the clouds below a folder, by name."""
        found = []
        for name, folders, files in os.walk(folder):
            place = Path(name)
            if self._is_skipped(place):
                folders.clear()
                continue
            folders[:] = [own for own in folders if not own.startswith('.')]
            for own in files:
                suffix = Path(own).suffix.lower()
                if suffix in SUFFIXES and suffix not in TABLES and not own.startswith('.') and (
                    not self._is_survey(place / own) and (place / own).is_file()
                ):
                    found.append(place / own)
        return iter(sorted(found))

    def match(self, pattern: str) -> Iterator[Path]:
        """Return the clouds that a pattern names, and those in the folders that it names."""
        names = sorted(glob.glob(pattern, recursive=True))
        if not names:
            raise DataError(f'{pattern} matches no file')
        parts = Path(pattern).parts
        num_plain = next(number for number, part in enumerate(parts) if glob.has_magic(part))
        wants_results = parts[-1] == POINTS
        for path in map(Path, names):
            near = [path, *path.parents][:len(path.parts) - num_plain + 1]
            if wants_results:
                is_result = self._is_in_out(path)
            else:
                is_result = any(map(self._is_skipped, near)) or self._is_survey(path)
            if is_result:
                continue
            if path.is_dir():
                yield from self.find(path)
            elif path.suffix.lower() in SUFFIXES:
                yield path

    def _is_skipped(self, folder: Path) -> bool:
        """Tell whether a run writes into a folder, or has written a ledger there."""
        if folder not in self._ledgers:
            self._ledgers[folder] = (folder / LEDGER).is_file()
        is_skipped = self._ledgers[folder] or self._is_in_out(folder)
        self.num_skipped += is_skipped
        return is_skipped

    def _is_survey(self, path: Path) -> bool:
        """Tell whether a file is one of the results of a single survey."""
        is_survey = path.name in FILES and (path.parent / 'run.json').is_file()
        self.num_skipped += is_survey
        return is_survey

    def _is_in_out(self, path: Path) -> bool:
        is_in_out = self._out is not None and self._out in (own := path.resolve(), *own.parents)
        self.num_skipped += is_in_out
        return is_in_out


def _expand(item: str, search: _Search) -> Iterator[Path]:
    path = Path(item)
    if path.is_dir():
        yield from search.find(path)
    elif not path.exists() and glob.has_magic(item):
        yield from search.match(item)
    elif path.suffix.lower() in INDEX_SUFFIXES and path.is_file():
        for name in _read_index(path):
            tile = path.parent / _find_path(name)
            if not tile.is_file():
                is_there = tile.exists() or '://' in name
                state = 'is not a file' if is_there else 'does not exist'
                raise DataError(f'{item} names {name}, which {state}')
            yield tile
    elif not path.exists():
        raise DataError(f'{item} does not exist')
    elif path.suffix.lower() in SUFFIXES:
        yield path


def _find_path(name: str) -> str:
    """Return the path in a tile index: plain, or a URL of a file, with its escapes."""
    return unquote(name.removeprefix('file://')) if name.startswith('file://') else name


def _read_index(path: Path) -> list[str]:
    """Return the paths that a tile index holds."""
    if path.suffix.lower() in ('.geojson', '.json', '.vpc'):
        try:
            features = json.loads(path.read_text(encoding='utf-8-sig'))['features']
            rows = [
                {'href': _find_asset(item.get('assets') or {})} | (item.get('properties') or {})
                for item in features
            ]
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(f'{path} is not a tile index: no GeoJSON features') from error
    else:
        rows = _read_table(path)
    names = []
    for number, row in enumerate(rows):
        lower = {str(key).lower(): value for key, value in row.items()}
        name = next((lower[key] for key in LOCATION_KEYS if lower.get(key)), None)
        if name is not None and not isinstance(name, str):
            raise DataError(f'{path}, feature {number + 1}: {name!r} is not the path of a tile')
        if name is None:
            raise DataError(
                f'{path}, feature {number + 1}: no path of a tile; expected one of '
                f'{", ".join(LOCATION_KEYS)} among {", ".join(sorted(lower)) or "no attributes"}'
            )
        names.append(name)
    return names


def _find_asset(assets: dict[str, Any]) -> Any:
    """Return the path of the cloud among the assets of a feature, as a virtual point cloud has."""
    places = [item.get('href') for item in (*filter(None, [assets.get('data')]), *assets.values())]
    clouds = [item for item in places if Path(str(item)).suffix.lower() in SUFFIXES]
    return next(iter([*clouds, *places]), None)


def _read_table(path: Path) -> list[dict[str, Any]]:
    import pyogrio

    from plc_inspect.offline.export.geo import name_plainly

    try:
        with warnings.catch_warnings(), name_plainly(path) as place:
            warnings.simplefilter('ignore', RuntimeWarning)  # the error says as much
            head, _, _, columns = pyogrio.raw.read(place, read_geometry=False)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError) as error:
        raise DataError(f'{path} is not a tile index: {make_one_line(error)}') from error
    return [dict(zip(head['fields'], row, strict=True)) for row in zip(*columns, strict=True)]
