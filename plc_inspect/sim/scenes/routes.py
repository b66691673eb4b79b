# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Routes of the simulated scenes in plan."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


def lay_route(
    lengths: tuple[float, ...], turns_deg: tuple[float, ...] = (), heading_deg: float = 0.0,
) -> Float64:
    """Return the supports (K, 2) of spans of given lengths, with turns between them [m]."""
    heading = np.radians(heading_deg)
    route = [np.zeros(2)]
    for i, length in enumerate(lengths):
        if i and i <= len(turns_deg):
            heading += np.radians(turns_deg[i - 1])
        route.append(route[-1] + length * np.array([np.cos(heading), np.sin(heading)]))
    return np.array(route)


def extend_route(route: Float64, before: float, after: float) -> Float64:
    """Return the route (K, 2) lengthened at its ends, or shortened if negative [m]."""
    first = (route[0] - route[1]) / np.hypot(*(route[0] - route[1]))
    last = (route[-1] - route[-2]) / np.hypot(*(route[-1] - route[-2]))
    return np.vstack([route[0] + before * first, route[1:-1], route[-1] + after * last])


def shift_route(route: Float64, offset: float) -> Float64:
    """Return the route shifted to the left by ``offset``, mitred at its vertices [m]."""
    edges = np.diff(route, axis=0)
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    joint = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    joint /= np.hypot(*joint.T)[:, None]
    cosine = np.einsum('ij,ij->i', joint, np.vstack([normals, normals[-1:]]))
    return route + offset * joint / cosine[:, None]


def walk_route(path: Float64, step: float) -> Float64:
    """Return positions (N, 2) every ``step`` along a path [m]."""
    return np.vstack([
        low + np.arange(0.0, 1.0, step / np.hypot(*(high - low)))[:, None] * (high - low)
        for low, high in pairwise(path)
    ])


def face_ahead(route: Float64, support: int) -> tuple[Float64, Float64, Float64]:
    """Return unit vectors (2,) along the spans before and after a support, and halfway."""
    before = route[support] - route[support - 1] if support else route[1] - route[0]
    after = route[support + 1] - route[support] if support + 1 < len(route) else before
    before, after = before / np.hypot(*before), after / np.hypot(*after)
    return before, after, (before + after) / np.hypot(*(before + after))


def face_side(route: Float64, pole: int, side: int) -> tuple[Float64, Float64]:
    """Return unit vectors (2,) along a route at one of its supports, and to one side."""
    ahead = route[min(pole + 1, len(route) - 1)] - route[max(pole - 1, 0)]
    ahead /= np.hypot(*ahead)
    return ahead, side * np.array([-ahead[1], ahead[0]])
