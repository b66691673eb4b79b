# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Simulated surveys for the benches, made once and kept in a folder.

A survey is kept under a name that holds a digest of the simulator's source, so that one made by
another version is never taken for this one's.
"""

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
import hashlib
import io
import json
import os
from pathlib import Path
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.config import Settings
from plc_inspect.errors import DataError
from plc_inspect.offline.readers.bag_map import accumulate
from plc_inspect.offline.readers.bags import Recording
import plc_inspect.sim
from plc_inspect.sim.evaluation.reference import parse_truth, Truth
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.simulate import main as simulate
from plc_inspect.sim.surveys.airborne import simulate_map
from plc_inspect.sim.surveys.truth import collect_sightings, make_truth
from plc_inspect.whole_files import replace_file

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

NOISE = 0.03
"""Standard deviation of each coordinate of a map [m]."""
_JUDGES = 'evaluation'
"""The package of the simulator that only judges."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """The points of one survey and the truth about them."""

    name: str
    points: Float64
    """(N, 3) [m]"""
    truth: Truth
    area: float
    """Ground that the survey covers [m2]."""


@contextmanager
def open_cache(folder: Path | None) -> Iterator[Path]:
    """Yield the folder for surveys, or a temporary one that is removed at the end."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix='plc_bench_') as room:
        yield Path(room)


def make_map(
    cache: Path, scene_name: str, *, density: float = 0.0, num_points: int | None = None,
    seed: int = 0,
) -> Survey:
    """
    Return an airborne map, from the cache if it is there.

    Parameters
    ----------
    cache : Path
        Folder of surveys.
    scene_name : str
        One of `plc_inspect.sim.scenes.catalogue.SCENES`.
    density : float
        Pulses per square metre.
    num_points : int, optional
        Exactly this number of points, instead of a density.
    seed : int
        Of the scene and of the scan.

    """
    size = f'{density:g}' if num_points is None else f'{num_points}points'
    stem = f'map_{scene_name}_{size}_{seed}'
    path = cache / f'{stem}_{_digest()}.npz'
    if not path.is_file():
        scene = make_scene(scene_name, seed)
        cloud = simulate_map(
            scene, density or 1.0, np.random.default_rng(seed), noise=NOISE,
            num_points=num_points,
        )
        truth = make_truth(
            scene, collect_sightings(scene, cloud.exact, cloud.label, cloud.conductor),
            kind='map', frame_id='map', bin_size=1.0, noise=NOISE,
        )
        with replace_file(path) as aside:
            np.savez(
                aside, points=cloud.points, label=cloud.label, truth=json.dumps(truth),
                area=scene.area,
            )
    with np.load(path) as content:
        return Survey(
            name=scene_name, points=content['points'], area=float(content['area']),
            truth=parse_truth(json.loads(str(content['truth'])), content['label']),
        )


def make_flight(cache: Path, scene_name: str, *, seed: int = 0) -> Survey:
    """
    Return the map that a simulated flight leaves, as `plc_replay` builds it.

    The recording is taken from the cache if it is there; the map is always made anew.
    """
    folder = cache / f'flight_{scene_name}_{seed}_{_digest()}'
    if not folder.is_dir():
        with redirect_stdout(io.StringIO()):
            code = simulate([scene_name, '-o', str(folder), '--seed', str(seed)])
        if code:
            raise DataError(f'the flight of {scene_name} was not made')
    settings = Settings()
    topics = settings.input.scan_topic, settings.input.odometry_topic
    with Recording(folder, *topics) as recording:
        voxels = accumulate(recording, settings).map
    points = voxels.centroids()[voxels.counts() >= settings.map.min_points]
    truth: dict[str, Any] = json.loads((folder / 'truth.json').read_text(encoding='utf-8'))
    return Survey(
        name=scene_name, points=points, truth=parse_truth(truth),
        area=make_scene(scene_name, seed).area,
    )


def _digest() -> str:
    """Return a digest of the simulator's source."""
    sources = sorted(Path(os.fspath(plc_inspect.sim.__path__[0])).rglob('*.py'))
    text = b''.join(path.read_bytes() for path in sources if path.parent.name != _JUDGES)
    return hashlib.sha256(text).hexdigest()[:12]
