# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Refuses scans of another frame or layout, of the same time as an earlier one, or from before."""

from collections import deque
from collections.abc import Sequence

from plc_inspect.core.mapping.scan_clock import SetBack
from plc_inspect.core.mapping.scan_counters import DropReason

REMEMBERED = 16
"""
Number of earlier scans that a new one is compared with.
Source: numerical: 0.8 s at 20 Hz; scans out of order are close to each other.
"""
MOST_OVERLAP = 0.2
"""
Greatest overlap in time of two scans, as a share of the shorter one.
Source: judgement; not measured.
"""
LEAST_STEP_NS = 2_000_000
"""
Least time between the stamps of two scans [ns].
Source: derived: 500 Hz, ten times as fast as sensors turn.
"""
LEAST_CONFLICTS = 4
"""
Scans of the last REMEMBERED that overlap others from which a second driver is on the topic.
Source: derived: one in four, as of a driver half of whose scans are lost; one stamp that is late
makes one, stamps that jitter by 8 ms at 10 Hz one in twenty.
"""
CONFLICT_NS = 10_000_000_000
"""
Time after such an overlap during which scans must keep to the period [ns].
Source: judgement; not measured.
"""
LEAST_LATER = 2
"""
Scans that come after another one but are from before it, which show that its stamp is wrong.
Source: derived: where two come in the wrong order it is one.
"""
LEAST_TIMED = 10
"""
Scans with times of their points, after which one without is refused: where it lies is smeared.
Source: judgement: a second of a driver, which does not lose them in flight.
"""
MOST_PHASE = 0.05
"""
Greatest deviation from a whole number of periods of scans in one rhythm, in periods.
Source: judgement; not measured.
"""


class ScanGate:
    """
    Decides which scans are accepted, by those accepted before.

    One sensor measures one scan at a time.  If two scans overlap in time, a second driver is on
    the topic, a message came twice, or the stamps are wrong; the first to arrive is kept, unless
    the other alone is in the rhythm of most before.  For a while after many such conflicts, scans
    off that rhythm are refused too, so that the other driver does not take over when a scan of the
    first is lost.

    A driver that is started anew may leave the times of points out: after LEAST_TIMED scans with
    them such scans are refused, as the smear of conductors would be raised as hazards.

    A scan from before all REMEMBERED may show that the clocks were set back, and the poses of its
    time be those from before: it is refused, until many show it, or the odometry does.
    """

    def __init__(self) -> None:
        self._frame_id = self._layout = ''
        self._num_timed = 0
        self._set_back = SetBack()
        self.forget_times()

    def forget_times(self) -> None:
        """Accept scans of any time next, as after time went back."""
        self._taken: deque[tuple[int, int, int]] = deque(maxlen=REMEMBERED)
        self._judged: deque[tuple[int, bool]] = deque(maxlen=REMEMBERED)
        self._disproved: deque[int] = deque(maxlen=REMEMBERED)
        """Stamps of scans that were accepted, and would not be now [ns]."""
        self._conflict: int | None = None
        self._set_back.clear()

    def judge(
        self, frame_id: str, layout: str, stamp_ns: int, times: tuple[int, int],
        period: float | None, timed: bool,
    ) -> DropReason | None:
        """
        Accept a scan, or return why not.

        Parameters
        ----------
        frame_id, layout : str
            Must be those of the first scan that has them.
        stamp_ns : int
            Header stamp [ns].
        times : tuple of int
            When the first and the last of its points were measured [ns].
        period : float or None
            Median time between scans [s].
        timed : bool
            Its points have times, or need none.

        Returns
        -------
        DropReason or None

        """
        self._frame_id = self._frame_id or frame_id
        self._layout = self._layout or layout
        if frame_id != self._frame_id:
            return DropReason.WRONG_FRAME
        if layout and layout != self._layout:
            return DropReason.OTHER_LAYOUT
        if not timed and self._num_timed >= LEAST_TIMED:
            return DropReason.NO_TIMES
        if any(stamp_ns == stamp for stamp, _ in self._judged):
            return DropReason.OVERLAP  # the same message again
        if len(self._taken) == REMEMBERED and stamp_ns < min(self._taken)[0]:
            if not self._set_back.add(stamp_ns):
                return DropReason.SET_BACK
            self.forget_times()
        self._set_back.clear()
        rivals = [item for item in self._taken if _overlap((stamp_ns, *times), item)]
        self._judged.append((stamp_ns, bool(rivals)))
        if rivals and sum(overlap for _, overlap in self._judged) >= LEAST_CONFLICTS:
            self._conflict = stamp_ns
        if not (
            self._is_right(stamp_ns, rivals, period) if rivals
            else self._is_in_rhythm(stamp_ns, period)
        ):
            return DropReason.OVERLAP
        self._num_timed += timed
        self._disprove(rivals)
        self._taken.append((stamp_ns, *times))
        self._disprove([
            item for number, item in enumerate(self._taken)
            if sum(later < item for later in list(self._taken)[number + 1 :]) >= LEAST_LATER
        ])
        return None

    def is_disproved(self, stamp_ns: int) -> bool:
        """Tell whether scans that came after an accepted one show that its stamp [ns] is wrong."""
        return stamp_ns in self._disproved

    def _disprove(self, scans: Sequence[tuple[int, int, int]]) -> None:
        for item in scans:
            self._taken.remove(item)
            self._disproved.append(item[0])

    def _is_right(
        self, stamp_ns: int, rivals: Sequence[tuple[int, int, int]], period: float | None
    ) -> bool:
        """Tell whether a scan keeps to the rhythm of most others, and those of its time do not."""
        others = [item[0] for item in self._taken if item not in rivals]
        if period is None or len(others) < LEAST_CONFLICTS:
            return False

        def keeps_time(stamp: int) -> bool:
            near = sum(_is_in_phase(stamp - other, period) for other in others)
            return 2 * near > len(others)

        return keeps_time(stamp_ns) and not any(keeps_time(item[0]) for item in rivals)

    def _is_in_rhythm(self, stamp_ns: int, period: float | None) -> bool:
        """Tell whether a scan keeps to the rhythm, where a second driver makes it necessary."""
        if self._conflict is None or period is None or not self._taken:
            return True
        if abs(stamp_ns - self._conflict) > CONFLICT_NS:
            return True
        return _is_in_phase(stamp_ns - self._taken[-1][0], period)


def _is_in_phase(step_ns: int, period: float) -> bool:
    """Tell whether a time is a whole number of periods [s]."""
    steps = step_ns * 1e-9 / period
    return abs(steps - round(steps)) <= MOST_PHASE


def _overlap(scan: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
    """Tell whether two scans (stamp, first and last time [ns]) cannot come from one sensor."""
    if abs(scan[0] - other[0]) < LEAST_STEP_NS:
        return True
    common = min(scan[2], other[2]) - max(scan[1], other[1])
    return common > MOST_OVERLAP * min(scan[2] - scan[1], other[2] - other[1])
