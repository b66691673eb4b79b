# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Pictures of random scenes: plan and side view, with what was found, missed and made up."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from plc_inspect.results import PointClass
from plc_inspect.sim.random_scenes.truth import RandomScene

mpl.use('Agg')

from matplotlib import pyplot as plt

MOST_POINTS = 60_000
"""Of one colour; more make a picture slower and no clearer."""


def draw(
    path: Path, made: RandomScene, classification: NDArray[np.uint8], title: str,
) -> None:
    """
    Draw a scene along its route, from above and from the side.

    Parameters
    ----------
    path : Path
        The PNG file to write.
    made : RandomScene
        The scene and its cloud.
    classification : ndarray
        (N,) uint8 classes that the pipeline gave its points.
    title : str
        Written above.

    """
    points, label = made.cloud.points, made.cloud.label
    start, end = made.scene.route[[0, -1]]
    along = (end - start) / np.hypot(*(end - start))
    s = (points[:, :2] - start) @ along
    t = (points[:, :2] - start) @ np.array([-along[1], along[0]])
    wire, called = label == PointClass.WIRE, classification == PointClass.WIRE
    layers = (
        ('ground', '#cccccc', 0.3, (label == PointClass.GROUND) & ~called),
        ('vegetation', '#8fc08f', 0.3, (label == PointClass.VEGETATION) & ~called),
        ('building, other', '#c9a46b', 0.6, ((label <= 1) | (label == 6)) & ~called),
        ('support', '#7f8fd0', 0.6, (label == PointClass.TOWER) & ~called),
        ('wire, found', 'black', 0.6, wire & called),
        ('wire, missed', 'red', 1.6, wire & ~called),
        ('called wire, wrongly', 'magenta', 2.0, ~wire & called & (label > 0)),
    )
    rng = np.random.default_rng(0)
    figure, (plan, side) = plt.subplots(2, 1, figsize=(18.0, 11.0), layout='constrained')
    for name, color, size, chosen in layers:
        rows = np.flatnonzero(chosen)
        if len(rows) > MOST_POINTS:
            rows = rng.choice(rows, MOST_POINTS, replace=False)
        style = {'color': color, 'marker': '.', 'markersize': size, 'linestyle': 'none'}
        plan.plot(s[rows], t[rows], label=f'{name} ({int(chosen.sum())})', **style)
        side.plot(s[rows], points[rows, 2], **style)
    plan.set(title=title, ylabel='across [m]', aspect='equal')
    side.set(xlabel='along [m]', ylabel='z [m]')
    plan.legend(markerscale=8.0, fontsize=8, loc='upper right')
    figure.savefig(path, dpi=80)
    plt.close(figure)
