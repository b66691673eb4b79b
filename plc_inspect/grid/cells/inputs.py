# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The files that name the inputs of a grid: clouds, folders, patterns and tile indices."""

from collections.abc import Iterator, Sequence
import glob
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote
import warnings

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.clouds import SUFFIXES
from plc_inspect.printable import make_one_line

INDEX_SUFFIXES = ('.geojson', '.json', '.vpc', '.gpkg', '.shp')
"""A tile index: GeoJSON, a virtual point cloud, GeoPackage, shapefile."""
TABLES = ('.csv',)
"""Skipped when a folder is searched: most hold something else than points."""
LOCATION_KEYS = ('location', 'path', 'file', 'filename', 'file_name', 'url', 'href')
"""Attributes of an index that hold the path of a tile, as PDAL, LAStools and lidR name it."""


def expand_inputs(items: Sequence[str]) -> list[Path]:
    """
    Find the files that the arguments name.

    Parameters
    ----------
    items : sequence of str
        Files, folders (searched at any depth), patterns, tile indices.

    Returns
    -------
    list of Path
        Each once: in the order of the arguments, and by name within each.

    Raises
    ------
    DataError
        There is no such file, or a folder, pattern or index holds no cloud.

    """
    found: dict[Path, None] = {}
    for item in items:
        own = list(_expand(item))
        if not own:
            raise DataError(f'{item} holds no cloud: none ends in {", ".join(SUFFIXES)}')
        found |= dict.fromkeys(own)
    return list(found)


def _expand(item: str) -> Iterator[Path]:
    path = Path(item)
    if path.is_dir():
        yield from _list_folder(path)
    elif not path.exists() and glob.has_magic(item):
        names = sorted(glob.glob(item, recursive=True))
        if not names:
            raise DataError(f'{item} matches no file')
        for name in names:
            if Path(name).is_dir():
                yield from _list_folder(Path(name))
            elif Path(name).suffix.lower() in SUFFIXES:
                yield Path(name).resolve()
    elif path.suffix.lower() in INDEX_SUFFIXES and path.is_file():
        for name in _read_index(path):
            tile = path.parent / _find_path(name)
            if not tile.is_file():
                is_there = tile.exists() or '://' in name
                state = 'is not a file' if is_there else 'does not exist'
                raise DataError(f'{item} names {name}, which {state}')
            yield tile.resolve()
    elif not path.exists():
        raise DataError(f'{item} does not exist')
    elif path.suffix.lower() in SUFFIXES:
        yield path.resolve()


def _find_path(name: str) -> str:
    """Return the path in a tile index: plain, or a URL of a file, with its escapes."""
    return unquote(name.removeprefix('file://')) if name.startswith('file://') else name


def _list_folder(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob('*')):
        suffix = path.suffix.lower()
        if suffix in SUFFIXES and suffix not in TABLES and path.is_file():
            yield path.resolve()


def _read_index(path: Path) -> list[str]:
    """Return the paths that a tile index holds."""
    if path.suffix.lower() in ('.geojson', '.json', '.vpc'):
        try:
            features = json.loads(path.read_text(encoding='utf-8'))['features']
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
    chosen: Any = assets.get('data') or next(iter(assets.values()), {})
    return chosen.get('href')


def _read_table(path: Path) -> list[dict[str, Any]]:
    import pyogrio

    try:
        with warnings.catch_warnings():  # the error says as much
            warnings.simplefilter('ignore', RuntimeWarning)
            head, _, _, columns = pyogrio.raw.read(path, read_geometry=False)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError) as error:
        raise DataError(f'{path} is not a tile index: {make_one_line(error)}') from error
    return [dict(zip(head['fields'], row, strict=True)) for row in zip(*columns, strict=True)]
