# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Poses of the vehicle from tf: the one moving transform between map and base."""

from plc_inspect.core.setup.transforms import (
    clean_frame,
    FrameTree,
    StampedTransform,
    to_matrix,
    to_quaternion,
)
from plc_inspect.errors import DataError
from plc_inspect.results import Float64

MOST_STEPS = 64
"""
Frames between map and base at most.
Source: numerical: ends the search where the frames go in a circle.
"""


class MovingFrames:
    """
    Turns transforms of /tf into poses of the base in the frame of the map.

    Between base and map one transform may move, and any number be fixed: of two that move, each
    has times of its own, and neither says where the other was.

    Parameters
    ----------
    fixed : FrameTree
        Of /tf_static; may grow.
    map_frame, base_frame : str
        Names of the frames.

    """

    def __init__(self, fixed: FrameTree, map_frame: str, base_frame: str) -> None:
        self._fixed = fixed
        self._map, self._base = clean_frame(map_frame), clean_frame(base_frame)
        self._parents: dict[str, str] = {}

    @property
    def complete(self) -> bool:
        """Whether a way leads from the base to the map."""
        return self._walk() is not None

    def _walk(self) -> list[str] | None:
        """Return the frames from the base whose parents lead to the map, None where none do."""
        frames, frame = [self._base], self._base
        while frame != self._map and len(frames) < MOST_STEPS:
            parent = self._parents.get(frame) or self._fixed.parent_of(frame)
            if parent is None:
                break
            frames.append(frame := parent)
        if frame == self._map:
            return frames[:-1]
        for number, frame in enumerate(frames):  # the map is fixed beside or below one of them
            if self._fixed.find(self._map, frame) is not None:
                return frames[:number]
        return None

    def explain(self) -> str:
        """Say how far the way from the base to the map leads, '' where it is whole."""
        if self.complete:
            return ''
        known = sorted(f'{parent} -> {child}' for child, parent in self._parents.items())
        return (
            f'/tf does not lead from {self._map} to {self._base} (input.map_frame, '
            f'input.base_frame); it holds {", ".join(known[:8]) or "nothing"}'
        )

    def add(self, item: StampedTransform) -> tuple[Float64, Float64] | None:
        """
        Take a transform of /tf.

        Parameters
        ----------
        item : StampedTransform
            Any; those that are not between base and map give no pose.

        Returns
        -------
        tuple[Float64, Float64] or None
            (3,) position of the base in the map [m] and (4,) its quaternion x y z w, at the stamp
            of the transform.

        Raises
        ------
        DataError
            The values are no transform, or two transforms move between base and map.

        """
        parent, child = clean_frame(item.parent), clean_frame(item.child)
        self._parents[child] = parent
        way = self._walk()
        if way is None or child not in way:
            return None
        moving = [frame for frame in way if frame in self._parents]
        if len(moving) > 1:
            raise DataError(
                f'{len(moving)} transforms move between {self._map} and {self._base}: those of '
                f'{" and ".join(moving)}; set input.map_frame or input.base_frame so that one is '
                'left'
            )
        outer = self._fixed.find(self._map, parent)
        inner = self._fixed.find(child, self._base)
        if outer is None or inner is None:
            return None
        pose = outer @ to_matrix(item) @ inner
        return pose[:3, 3].copy(), to_quaternion(pose[:3, :3])
