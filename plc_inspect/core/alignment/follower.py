# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Keeps the map consistent when the odometry is not: steps, frozen poses, drift.

The first points seen are the reference.  As long as new scans fit it, nothing is moved.  After a
step, scans wait until they are registered to it, with the vehicle's motion as prior.  If they
cannot be registered, the map starts anew, as otherwise every wire would show twice.
"""

from collections.abc import Generator, Iterator
from dataclasses import replace

import numpy as np

from plc_inspect.core.alignment.cell_comparison import LEAST_LOOKS, OPEN_NS
from plc_inspect.core.alignment.drift_filter import DriftFilter
from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.parts import BY_RATE, gather_points, Part, Seen
from plc_inspect.core.alignment.pending_break import PendingBreak, SAME
from plc_inspect.core.alignment.pose_watch import Break, Oddity, PoseWatch
from plc_inspect.core.alignment.registration import Fit, fit_heading, fit_points, sample_points
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.alignment.steady_errors import AGAIN, SteadyErrors
from plc_inspect.results import Float64

REACH = 40.0
"""
Greatest distance from the lidar of points that are compared [m].
Source: derived: 0.05 degrees of attitude move them by 0.035 m.
"""
WIDE = 60.0
"""
The same after a break, as the vehicle may have moved far meanwhile [m].
Source: derived: 5 s without poses at 7 m/s.
"""
BATCH_NS = 500_000_000
"""Duration of a batch of scans that is compared [ns].  Source: judgement: 2.5 m at 5 m/s."""
WAIT_NS, MOST_WAIT_NS = 400_000_000, 1_000_000_000
"""
Duration of scans that are registered after a step, and their longest wait [ns].
Source: judgement: four scans at 10 Hz; an error must be reported within 2 s.
"""
LEAST_MATCHED = 150
"""Least number of points in known cells for a judgement.  Source: judgement."""
LEAST_FEW = 50
"""The same of the few for which the turn is searched.  Source: as LEAST_MATCHED, of a third."""
LEAST_SHARE = 0.5
"""Least share of them that must fit.  Source: measured: bench/studies/odometry_faults.py."""
MOST_SIGMA = 0.15
"""Greatest standard deviation of a part's place [m].  Source: derived: 0.2 m must hold."""
ENGAGE, ENGAGE_AGAIN = 0.15, 0.12
"""
Drift from which scans are corrected, within a pass and after the vehicle has come back [m].
Source: measured: bench/studies/odometry_faults.py and the demo flight: good odometry stays below.
"""
SURELY, SURELY_AGAIN = 4.0, 2.0
"""
Standard deviations from which drift counts, likewise; 2 in a pass held the demo's odometry for it.
Source: measured: odometry_faults.py --seeds 61 63: doubled by 0.27 m with 4 again, 0.20 m with 2.
"""
TWICE = 2
"""Consecutive batches that must agree.  Source: judgement."""
SEEDED = 150.0
"""Radius about the vehicle of the reference in a resumed map [m].  Source: numerical: 0.2 s."""
LOST_AFTER = 4
"""Consecutive batches that do not fit before a new part begins.  Source: derived: 2 s."""


class Follower:
    """Moves scans from the odometry's frame into the map frame; not thread-safe."""

    def __init__(self) -> None:
        self.parts: list[Part] = []
        """All parts but the first."""
        self.watch, self.steady = PoseWatch(), SteadyErrors()
        self._cells = NormalCells()
        self._filter: DriftFilter | None = None
        self._place, self._stamp = np.zeros(3), 0
        self.num_given_up = 0
        """Scans that waited for registration and were given up, since the start."""
        self._waiting: list[Seen] = []
        self.clear()

    def clear(self) -> None:
        """Reset, with the odometry uncorrected."""
        self._cells.clear()
        self._following = False
        self._held = RigidMove()
        self.forget_times()

    def forget_times(self) -> None:
        """Reset the pose history, as after time went back; the map stays."""
        self.watch.clear()
        self._held = self.move
        self._filter, self._following = None, False
        self._onset_ns, self._setting_in, self._lag = 0, 0.0, RigidMove()
        self._pending: PendingBreak | None = None
        self._give_up_waiting()
        self._batch: list[Seen] = []
        self._due: tuple[list[Seen], Float64] | None = None  # and where the vehicle was then
        self._doubts = self._strays = 0
        self.steady.clear()

    def resume(
        self, move: RigidMove, points: Float64, stamp_ns: int, place: Float64 | None,
        parts: list[Part], doubt: str = '',
    ) -> None:
        """
        Resume the state of another process.

        Parameters
        ----------
        move : RigidMove
            The last move.
        points : Float64
            (N, 3) of the map [m].
        stamp_ns : int
            Of the newest scan [ns].
        place : Float64 or None
            (3,) last position of the vehicle in the map [m]; what is near becomes the reference.
        parts, doubt : list of Part, str
            As of then.

        """
        self._held, self.parts, self.steady.doubt = move, parts, doubt
        if place is not None:
            near = points[((points[:, :2] - place[:2]) ** 2).sum(axis=1) < SEEDED**2]
            for look in range(LEAST_LOOKS):
                self._cells.add(near, stamp_ns - 2 * OPEN_NS + look)

    @property
    def move(self) -> RigidMove:
        """Move from the present frame of the odometry into the map frame."""
        return self._move_at(self._stamp)

    def _move_at(self, stamp_ns: int) -> RigidMove:
        """Return the move at a time near the last [ns]; a part of it while it sets in."""
        if not self._following or self._filter is None:
            return self._held
        move = self._filter.move_at(stamp_ns)
        left = 1.0 - (stamp_ns - self._onset_ns) * 1e-9 / max(self._setting_in, 1e-9)
        if left <= 0.0:
            return move
        left = min(left, 1.0)
        return RigidMove(
            move.shift - left * self._lag.shift, move.yaw - left * self._lag.yaw, move.centre
        )

    @property
    def waits(self) -> bool:
        """Whether a break is under examination."""
        return self._pending is not None

    @property
    def likely_move(self) -> RigidMove | None:
        """The likely move of the newest pose during an examination; None if unknown."""
        if self.watch.frozen:
            return None
        if self._pending is None:
            return self.move
        known = self._pending.quick and self._pending.sigma <= MOST_SIGMA
        return self.move.after(self._pending.total) if known else None

    @property
    def following(self) -> bool:
        """Whether scans are corrected gradually, as the odometry drifts."""
        return self._following

    @property
    def doubt(self) -> str:
        """Why no results may be reported, '' if they may."""
        return self.steady.doubt

    @property
    def num_waiting(self) -> int:
        """Number of scans waiting for registration."""
        return len(self._waiting)

    def see_pose(self, stamp_ns: int, position: Float64, quaternion: Float64) -> Break | None:
        """
        Examine an accepted pose.

        Parameters
        ----------
        stamp_ns : int
            Later than the one before [ns].
        position : Float64
            (3,) in the odometry's frame [m].
        quaternion : Float64
            (4,) x y z w.

        Returns
        -------
        Break or None
            The break before it, if any; poses must not be interpolated over a break.

        """
        self._place, self._stamp = np.array(position, dtype=np.float64), stamp_ns
        found = self.watch.see(stamp_ns, position, quaternion)
        if found is None and self._pending is not None:
            self._pending.judge(self.watch.velocity_since)
        if found is None or found.oddity is Oddity.FROZEN:
            return found
        if self._pending is None:
            self._pending = PendingBreak.begin(found)
            return found
        self._pending.add(found, self._place)
        self._give_up_waiting()
        if self._pending.is_none:
            self._pending = None
        return found

    def _give_up_waiting(self) -> None:
        self.num_given_up += len(self._waiting)
        self._waiting = []

    def take(self, scan: Seen) -> Iterator[Seen | Part | None]:
        """
        Take a scan, and yield what can go into the map.

        Parameters
        ----------
        scan : Seen
            In the odometry's frame.

        Yields
        ------
        Seen, Part or None
            Scans in the map frame, or a part that is not aligned, with which the map starts anew;
            None in between.

        """
        last = int(scan.stamps.max(initial=scan.stamp_ns))
        if self._pending is None or last < self._pending.begin_ns:
            yield from self._release(scan)
            return
        self._waiting.append(scan)
        yield from self.settle(self._stamp)

    def settle(self, now_ns: int, *, at_once: bool = False) -> Iterator[Seen | Part | None]:
        """Yield scans that waited for a break, once it is resolved or the wait has ended."""
        if self._pending is None or not self._waiting:
            return
        begin = self._pending.begin_ns
        long = self._waiting[-1].stamp_ns - begin >= WAIT_NS and len(self._waiting) > 2
        if not long and now_ns - begin < MOST_WAIT_NS and not at_once:
            return
        yield from self.catch_up()
        pending, scans = self._pending, self._waiting
        self._pending, self._waiting, self._batch = None, [], []
        yield from self._note(self._resolve(pending, scans))
        for scan in scans:
            yield from self._release(scan)

    def _release(self, scan: Seen) -> Iterator[Seen | Part | None]:
        """Yield a scan in the map frame; a batch that it ends is due to be compared."""
        yield from self.catch_up()
        self._batch.append(scan)
        if scan.stamp_ns - self._batch[0].stamp_ns >= BATCH_NS:
            self._due, self._batch = (self._batch, self._place), []
        yield replace(scan, points=self._move_at(scan.stamp_ns).apply(scan.points))

    def catch_up(self) -> Iterator[Part | None]:
        """
        Compare the batch that is due with the reference, if one is.

        It takes longer than a scan may keep a pose waiting: whoever can does it in pieces, before
        the next scan.

        Yields
        ------
        Part or None
            None between pieces; a part that is not aligned, with which the map starts anew.

        """
        if self._due is not None:
            batch, self._due = self._due, None
            part = yield from self._learn(*batch)
            yield from self._note(part)

    def _note(self, part: Part | None) -> Iterator[Part]:
        """Store a part, and yield it if the map starts anew with it."""
        if part is not None:
            self.parts.append(part)
            if not part.aligned:
                yield part

    def _learn(self, batch: list[Seen], place: Float64) -> Generator[None, None, Part | None]:
        """Compare a batch, which ended with the vehicle at a place, and add it; in pieces."""
        points = gather_points(batch, REACH)
        stamp = batch[len(batch) // 2].stamp_ns
        if self._filter is None:
            self._filter = DriftFilter(self._held.about(place), stamp)
        tracked = self._filter
        self.steady.begin(tracked, place)
        way = tracked.predict(stamp, place)
        known = sample_points(points), tracked.move, tracked.covariance, stamp
        yield None
        fit = fit_points(self._cells, *known, held=None if self._following else self._held)
        yield None
        free = fit_heading(self._cells, *known)
        if free.matched >= LEAST_FEW and free.share >= LEAST_SHARE:
            self.steady.judge_heading(fit, free)
        part: Part | None = None
        if fit.matched >= LEAST_MATCHED:
            if fit.share >= LEAST_SHARE:
                tracked.update(fit)
                self._strays = 0
                part = self._judge(fit, stamp)
            elif self._following:
                self._strays += 1
        part = part or self._mend(tracked, way, place, stamp)
        if self._strays >= LOST_AFTER:
            part = self._give_up('the odometry drifts, and what is seen does not fit', stamp)
        now = self._move_at(stamp)
        self._cells.add(now.apply(points), stamp, now.apply(place))
        return part

    def _judge(self, fit: Fit, stamp: int) -> Part | None:
        """Start to correct scans if they certainly lie beside the map."""
        if self._following:
            if self.parts:
                sigma = _find_sigma(fit.covariance)
                self.parts[-1] = replace(self.parts[-1], move=fit.move, sigma=sigma)
            return None
        off = fit.move.shift - self._held.about(fit.move.centre).shift
        size = float(np.linalg.norm(off))
        way = off / max(size, 1e-9)
        sigma = float(np.sqrt(way @ fit.covariance[:3, :3] @ way))
        least, surely = (ENGAGE_AGAIN, SURELY_AGAIN) if fit.age > AGAIN else (ENGAGE, SURELY)
        self._doubts = self._doubts + 1 if size > max(least, surely * sigma) else 0
        if self._doubts < TWICE:
            return None
        self._following = True
        within = fit.age * min(1.0, ENGAGE / size) if fit.age <= AGAIN else 0.0
        self._onset_ns, self._setting_in = stamp, within
        self._lag = RigidMove(off, fit.move.yaw - self._held.yaw)
        return Part(
            begin_ns=stamp, cause='the odometry drifts', move=fit.move,
            sigma=_find_sigma(fit.covariance), aligned=True, by='what was seen twice',
        )

    def _mend(
        self, tracked: DriftFilter, way: float, place: Float64, stamp: int
    ) -> Part | None:
        """Restart with a corrected odometry if it has a steady error."""
        cause = self.steady.judge_way(tracked, way, place)
        if not cause:
            return None
        self._cells.clear()
        self._following, self._setting_in, self._doubts = True, 0.0, 0
        return Part(
            begin_ns=stamp, cause=cause, move=tracked.move, sigma=0.0, aligned=False, by=BY_RATE
        )

    def _resolve(self, pending: PendingBreak, scans: list[Seen]) -> Part | None:
        """Register the scans after a break."""
        points = sample_points(gather_points(scans, WIDE))
        stamp, before = scans[-1].stamp_ns, self.move
        best = pending.register(self._cells, points, before, self._place, stamp)
        by = 'what was seen twice'
        if best is None or best.matched < LEAST_MATCHED:
            if not pending.is_little:
                return self._give_up(pending.cause, pending.begin_ns)
            by = 'the motion'
            moved = before.after(pending.total).about(self._place)
            spread = pending.spread
        elif best.share < LEAST_SHARE or _find_sigma(best.covariance) > MOST_SIGMA:
            return self._give_up(pending.cause, pending.begin_ns)
        else:
            moved, spread = best.move, best.covariance
        if pending.was_none(before, moved, spread):
            return None
        old, self._filter = self._filter, DriftFilter(moved, stamp, spread)
        if old is not None:
            self._filter.carry(old)
        self.steady.step()
        self._held, self._setting_in = moved, 0.0
        change = np.linalg.norm(moved.shift - before.about(moved.centre).shift)
        if pending.quick and change < SAME:
            return None
        return Part(
            begin_ns=pending.begin_ns, cause=pending.cause, move=moved,
            sigma=_find_sigma(spread), aligned=True, by=by,
        )

    def _give_up(self, cause: str, stamp: int) -> Part:
        """Restart with the odometry uncorrected."""
        self._cells.clear()
        self._held, self._filter, self._following = RigidMove(), None, False
        self._doubts = self._strays = 0
        self.steady.give_up()
        return Part(begin_ns=stamp, cause=cause, move=RigidMove(), sigma=0.0, aligned=False)


def _find_sigma(covariance: Float64) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
