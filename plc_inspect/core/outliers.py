# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Statistical outlier removal."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.config import OutlierSettings
from plc_inspect.results import Bool, Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OutlierResult:
    """Which of M positions have neighbours at a usual distance."""

    keep: Bool
    """(M,) True for inliers."""
    mean: float
    """Mean over all positions of the mean distance to the neighbours [m]."""
    sigma: float
    """Standard deviation of it [m]."""
    threshold: float
    """Greatest mean distance of an inlier [m]."""


def remove_outliers(positions: Float64, settings: OutlierSettings) -> OutlierResult:
    """
    Drop positions whose mean distance to their neighbours is unusually great.

    The mean distance to the ``num_neighbors`` nearest others is compared with mean + ``sigma``
    standard deviations over the whole set (Shi et al. 2018, cited by the paper).  A set too
    small to have that many neighbours is kept whole.  O(M log M).

    Parameters
    ----------
    positions : (M, 3) float64
        Coordinates [m].
    settings : OutlierSettings
        Settings of this stage.

    Returns
    -------
    OutlierResult

    """
    num = settings.num_neighbors
    if len(positions) <= num:
        keep = np.ones(len(positions), dtype=bool)
        return OutlierResult(keep=keep, mean=0.0, sigma=0.0, threshold=np.inf)
    distance, _ = cKDTree(positions, balanced_tree=False).query(
        positions, k=num + 1, workers=-1
    )
    average = distance[:, 1:].mean(axis=1)
    mean, sigma = float(average.mean()), float(average.std())
    threshold = mean + settings.sigma * sigma
    return OutlierResult(keep=average <= threshold, mean=mean, sigma=sigma, threshold=threshold)
