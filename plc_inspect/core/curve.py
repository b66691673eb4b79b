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

"""A piece of conductor in space: a catenary in a vertical plane."""

from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.catenary import CatenaryFit, fit_catenary
from plc_inspect.errors import FitError
from plc_inspect.results import Float64, Int64

MAX_POINTS = 2000
"""Points that a fit needs while conductors are looked for."""
MIN_TOLERANCE = 0.1
MAX_TOLERANCE = 0.35
"""Bounds of the residual of an inlier, when it is derived from the noise [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """
    A conductor in the frame of its own vertical plane (regularised, R_z of the paper).

    x runs along ``azimuth`` from ``origin``, y to the left of it, z up and absolute.
    """

    origin: Float64
    """(2,) plan position of x = 0 [m]."""
    azimuth: float
    """Direction of x, counter-clockwise from the map's x [rad]."""
    fit: CatenaryFit
    low: float
    """Least x of the points [m]."""
    high: float
    """Greatest x of the points [m]."""
    lateral_rmse: float
    """Root mean square of y of the inliers [m]."""
    lateral_sigma: tuple[float, float]
    """Standard deviations of the plane's offset [m] and azimuth [rad], about the mean x."""
    mean_x: float
    tolerance: float
    """Largest residual of an inlier, across and vertically [m]."""
    points: Int64
    """Indices of the inliers, ascending; one in ``stride`` of them."""
    stride: int
    """How many points of the cloud each of ``points`` stands for."""

    @property
    def num_points(self) -> int:
        """Number of inliers in the cloud, estimated where it was thinned."""
        return len(self.points) * self.stride

    @property
    def length(self) -> float:
        """Horizontal extent of the points [m]."""
        return self.high - self.low

    def local(self, points: Float64) -> tuple[Float64, Float64]:
        """Return x along and y across of (N, 2+) points, (N,) each [m]."""
        dx, dy = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        return ca * dx + sa * dy, ca * dy - sa * dx

    def position(self, x: Float64 | float) -> Float64:
        """Return the (N, 3) points of the curve at (N,) x [m]."""
        x = np.atleast_1d(np.asarray(x, dtype=np.float64))
        return np.stack(
            [
                self.origin[0] + math.cos(self.azimuth) * x,
                self.origin[1] + math.sin(self.azimuth) * x,
                self.fit.height(x),
            ],
            axis=1,
        )

    def prediction_sigma(self, x: Float64) -> Float64:
        """Return the standard deviation of the curve's position at (N,) x [m]."""
        offset, turn = self.lateral_sigma
        lateral = offset**2 + (turn * (x - self.mean_x)) ** 2
        result: Float64 = np.sqrt(lateral + self.fit.height_sigma(x) ** 2)
        return result


def fit_curve(
    points: Float64,
    chosen: Int64,
    *,
    tolerance: float,
    num_trials: int = 64,
    rng: np.random.Generator | None = None,
    max_points: int = MAX_POINTS,
    azimuth: float | None = None,
) -> Curve:
    """
    Fit a vertical plane and a catenary in it to points of one conductor.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    chosen : (K,) int64
        Indices of the conductor's points, ascending, no repeats.
    tolerance : float
        Largest residual of an inlier, across and vertically [m].
    num_trials, rng : int, numpy.random.Generator or None
        Of MSAC; without ``rng`` all points start as inliers.
    max_points : int
        More points than this are thinned evenly.
    azimuth : float or None
        The curve's x runs this way rather than opposite [rad]; by default to the east.

    Returns
    -------
    Curve

    Raises
    ------
    FitError
        Fewer than four points agree on a curve.

    """
    stride = max(-(-len(chosen) // max_points), 1)
    chosen = chosen[::stride]
    if len(chosen) < 4:
        raise FitError(f'a conductor needs 4 points, got {len(chosen)}')
    own = points[chosen]
    origin = own[:, :2].mean(axis=0)
    wanted = azimuth
    azimuth = _principal_azimuth(own[:, :2] - origin)
    if wanted is not None and math.cos(azimuth - wanted) < 0:
        azimuth += math.pi
    keep = np.ones(len(own), dtype=bool)
    for _ in range(4):
        x, y = _rotate(own[:, :2] - origin, azimuth)
        if keep.sum() < 4:
            break
        slope, offset = _line(x[keep], y[keep])
        origin = origin + offset * np.array([-math.sin(azimuth), math.cos(azimuth)])
        azimuth += math.atan(slope)
        x, y = _rotate(own[:, :2] - origin, azimuth)
        keep = np.abs(y) <= tolerance
    if keep.sum() < 4:
        raise FitError(f'{int(keep.sum())} of {len(own)} points lie in a vertical plane')
    fit = fit_catenary(
        x[keep], own[keep, 2], tolerance=tolerance, num_trials=num_trials, rng=rng
    )
    inlier = np.flatnonzero(keep)[fit.inlier]
    if len(inlier) < 4:
        raise FitError(f'{len(inlier)} of {len(own)} points lie on a catenary')
    azimuth = math.remainder(azimuth, 2 * math.pi)
    along, across = x[inlier], y[inlier]
    rms = float(np.sqrt(np.mean(across**2)))
    mean = float(along.mean())
    spread = max(float(((along - mean) ** 2).sum()), 1e-9)
    noise = max(rms, 1e-3)
    return Curve(
        origin=origin,
        azimuth=azimuth,
        fit=fit,
        low=float(along.min()),
        high=float(along.max()),
        lateral_rmse=rms,
        lateral_sigma=(noise / math.sqrt(len(inlier)), noise / math.sqrt(spread)),
        mean_x=mean,
        tolerance=tolerance,
        points=chosen[inlier].astype(np.int64),
        stride=stride,
    )


def derive_tolerance(noise: float) -> float:
    """Residual that separates inliers from others, for a noise (rms) [m]."""
    return min(max(3.0 * noise, MIN_TOLERANCE), MAX_TOLERANCE)


def _principal_azimuth(centered: Float64) -> float:
    """Direction of greatest spread, in (-pi/2, pi/2]."""
    xx, xy, yy = (
        float((centered[:, i] * centered[:, j]).sum()) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    return 0.5 * math.atan2(2 * xy, xx - yy)


def _rotate(centered: Float64, azimuth: float) -> tuple[Float64, Float64]:
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    return (
        ca * centered[:, 0] + sa * centered[:, 1],
        ca * centered[:, 1] - sa * centered[:, 0],
    )


def _line(x: Float64, y: Float64) -> tuple[float, float]:
    """Slope and the offset at x = 0 of the least-squares line."""
    mx, my = x.mean(), y.mean()
    spread = ((x - mx) ** 2).sum()
    slope = float(((x - mx) * (y - my)).sum() / spread) if spread > 1e-9 else 0.0
    return slope, float(my - slope * mx)
