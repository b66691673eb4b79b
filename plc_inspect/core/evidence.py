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

"""Evidence that a curve is a conductor, and not an edge that happens to be straight."""

import math

from plc_inspect.config import CatenarySettings
from plc_inspect.core.collection import Profile
from plc_inspect.core.curve import Curve

UNPROVEN = 'curvature not proven'
CROWDED = 'not free in the air'


def find_objection(curve: Curve, profile: Profile, settings: CatenarySettings) -> str:
    """
    Return why a curve is not believed to be a conductor, or an empty string.

    A conductor is long, seen along most of its length, hangs with a curvature that its points
    prove, sags no more than lines do, and has air about it.  Roof ridges, rails and walls are
    straight or go on beside the axis; arcs of single scan lines are too deep or too short.

    Parameters
    ----------
    curve : Curve
        The curve.
    profile : Profile
        Of the curve between its ends.
    settings : CatenarySettings
        Settings of this stage.

    """
    if curve.length < settings.min_length:
        return 'too short'
    if curve.num_points < settings.min_points:
        return 'too few points'
    if profile.coverage < settings.min_coverage:
        return 'seen in too few places'
    curvature = float(curve.fit.shape[2])
    sigma = math.sqrt(max(float(curve.fit.covariance[2, 2]), 0.0))
    if curvature < settings.min_significance * sigma:
        return UNPROVEN
    if curve.fit.c > settings.max_constant:
        return 'straighter than a conductor'
    if curve.fit.sag(curve.low, curve.high)[0] > settings.max_sag_ratio * curve.length:
        return 'deeper than a conductor'
    if profile.crowding > settings.max_crowding:
        return CROWDED
    return ''
