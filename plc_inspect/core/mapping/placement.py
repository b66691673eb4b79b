# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Transforms the points of a scan into the map frame, or says why that is impossible."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.deskew import deskew
from plc_inspect.core.mapping.pose_buffer import Bracket, PoseBuffer
from plc_inspect.core.mapping.scan_counters import DropReason
from plc_inspect.core.setup.mount import choose_mount, Mount
from plc_inspect.core.setup.transforms import clean_frame, FrameTree, StampedTransform
from plc_inspect.results import Float32, Float64, Int64

_REASON_OF_BRACKET = {
    Bracket.BEFORE: DropReason.NO_POSE_BEFORE,
    Bracket.AFTER: DropReason.NO_POSE_AFTER,
    Bracket.GAP: DropReason.POSE_GAP,
    Bracket.JUMP: DropReason.POSE_JUMP,
    Bracket.FROZEN: DropReason.POSE_FROZEN,
}


@dataclass(frozen=True, slots=True, eq=False)
class WaitingScan:
    """A scan that waits for the odometry."""

    stamp_ns: int
    xyz: Float32
    """(N, 3) in the frame of the lidar, or of the odometry if ``placed`` [m]."""
    stamps: Int64
    """(N,) [ns]."""
    first: int
    last: int
    """Least and greatest of the stamps [ns]."""
    arrival: float | None
    placed: bool
    """Whether the points are in the frame of the odometry already."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """Points of a scan in the map frame."""

    points: Float64
    """(M, 3) [m]."""
    stamps: Int64
    """(M,) [ns]."""
    apart: Float64
    """(M,) distance from the lidar [m]."""
    num_near: int = 0
    """Points left out as too near or too far, of a scan that came in the map frame."""
    num_far: int = 0


class Placer:
    """
    Transforms scans into the map frame by poses and mount.

    Parameters
    ----------
    settings : InputSettings
        Mount, ranges, ``use_tf`` and ``base_frame`` are used.

    """

    def __init__(self, settings: InputSettings) -> None:
        self.frames = FrameTree()
        """Transforms of /tf_static."""
        self._base = self._lidar = ''
        self.configure(settings)

    def configure(self, settings: InputSettings) -> None:
        """Use other settings from now on."""
        self._settings = settings
        self._mount: Mount | None = None

    def add_frame(self, item: StampedTransform) -> None:
        """
        Add a transform of /tf_static.

        Raises
        ------
        DataError
            Its values do not form a transform.

        """
        self.frames.add(item)
        self._mount = None

    def set_frames(self, odometry: tuple[str, str] | None, lidar: str) -> None:
        """Set the frames of the odometry and the base, None if unknown, and of the scans."""
        frame, base = odometry or ('', '')
        if is_placed(lidar, frame):
            lidar = ''  # the scans are in the map frame already
        if (base, lidar) != (self._base, self._lidar):
            self._base, self._lidar = base, lidar
            self._mount = None

    @property
    def mount(self) -> Mount:
        """The mount in use."""
        if self._mount is None:
            self._mount = choose_mount(self._settings, self.frames, self._base, self._lidar)
        return self._mount

    def place(self, scan: WaitingScan, poses: PoseBuffer) -> PlacedScan | DropReason:
        """
        Return the points of a scan in the map frame, each by the pose of its own time.

        Points of a scan that came in the map frame are not moved; those out of range of the
        lidar's position at their time are left out.
        """
        seen = np.zeros_like(scan.xyz) if scan.placed else scan.xyz
        result = deskew(seen, scan.stamps, poses, self.mount.transform)
        if not result.complete:
            return _REASON_OF_BRACKET[Bracket(int(result.bracket.max()))]
        if not scan.placed:
            return PlacedScan(result.points, scan.stamps, _measure(scan.xyz))
        apart = _measure(scan.xyz - result.points)
        near, far = apart < self._settings.min_range, apart > self._settings.max_range
        kept = ~(near | far)
        return PlacedScan(
            scan.xyz[kept].astype(np.float64), scan.stamps[kept], apart[kept],
            int(near.sum()), int(far.sum()),
        )


def is_placed(frame_id: str, map_frame: str) -> bool:
    """Tell whether scans of a frame come in the map frame, with or without a leading slash."""
    return bool(frame_id) and clean_frame(frame_id) == clean_frame(map_frame)


def _measure(points: Float32 | Float64) -> Float64:
    """Return the lengths of (N, 3) vectors."""
    result: Float64 = np.sqrt(np.einsum('ij,ij->i', points, points))
    return result
