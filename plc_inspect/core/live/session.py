# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The work of the node's worker: windows of the map in, the state of the inspection out.

One thread owns a session; the states that it returns never change.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
import time

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.cloud_frame import CloudFrame, find_cloud_frame
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.live.corridor_points import (
    CorridorPoints,
    map_numbers,
    no_corridor,
    renumber,
)
from plc_inspect.core.live.map_labels import label_points
from plc_inspect.core.live.surroundings import Surroundings, SurroundingsBook
from plc_inspect.core.live.views import ViewCounter
from plc_inspect.core.live.window import sample_span, SPACING, Window
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.setup.looks import LookWindow, Spread
from plc_inspect.core.setup.plumb import Leans, measure_leans, NO_LEANS, PlumbBook
from plc_inspect.core.setup.sharpness import Sharpness, SharpnessBook
from plc_inspect.core.tracking.hazard_tracking import (
    carry_numbers,
    HazardBook,
    HazardNews,
    KeptHazards,
)
from plc_inspect.core.tracking.span_registry import SpanRegistry
from plc_inspect.core.tracking.support_tracking import KeptSupports, SupportBook
from plc_inspect.core.tracking.tracked_span import KeptSpans, TrackedSpan
from plc_inspect.results import (
    Bool,
    Float64,
    Hazard,
    InspectionResult,
    SpanKey,
    StageReport,
    Support,
    UInt8,
)

CORRIDOR_REACH = 150.0
"""
Distance from the vehicle within which corridor points are kept for messages [m].
Source: judgement; not measured.
"""
REMEMBERED = 84
"""
Windows by which the sharpness of the map is judged.
Source: derived: a minute of flight, 1.4 windows a second in the three scales.
"""
FINISHED_DISTANCE = 150.0
"""
Distance from the vehicle beyond which a span with nothing new in it is finished [m].
Source: judgement; not measured.
"""
FINISHED_SPACING = 20.0
"""
Spacing of the samples that give a span's distance, at most [m].
Source: judgement; not measured.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LiveState:
    """Everything that is known after a tick."""

    spans: tuple[TrackedSpan, ...] = ()
    """Ordered by line_id, then span_id; those with numbers below 0 are not confirmed yet."""
    supports: tuple[Support, ...] = ()
    hazards: tuple[Hazard, ...] = ()
    awaited: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    """(W, 3) where hazards are that wait to be seen again [m]; none while all are held back."""
    sharpness: Sharpness = field(default_factory=Sharpness)
    """Of the map; hazards are held back where it is poor."""
    corridor: CorridorPoints
    around: Surroundings = field(default_factory=Surroundings)
    """What may be near the vehicle."""
    news: HazardNews = field(default_factory=HazardNews)
    stages: tuple[StageReport, ...] = ()
    num_points: int = 0
    """Points of the window."""
    num_merges: int = 0
    """Lines that proved to be part of an older one, since the start."""
    sequence: int = 0
    """Newest insertion of the map that is in."""
    seconds: float = 0.0
    """Wall time of the tick."""

    @property
    def confirmed(self) -> tuple[TrackedSpan, ...]:
        """Spans that may be published."""
        return tuple(item for item in self.spans if item.confirmed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tick:
    """The result of one window."""

    state: LiveState
    labels: UInt8
    """(N,) label of each point of the window, for the map; (0,) where nothing was looked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """What a session keeps from tick to tick, but for the points of the corridor."""

    spans: KeptSpans = field(default_factory=KeptSpans)
    hazards: KeptHazards = field(default_factory=KeptHazards)
    supports: KeptSupports = field(default_factory=KeptSupports)
    spreads: tuple[Spread, ...] = ()
    """What tells how sharp the map is."""
    leans: Leans = NO_LEANS
    """What tells whether it stands upright."""


class Session:
    """Runs the pipeline tick by tick, and keeps what is known."""

    def __init__(self) -> None:
        self._registry = SpanRegistry()
        self._hazards = HazardBook()
        self._supports = SupportBook()
        self._corridor = no_corridor()
        self._surroundings = SurroundingsBook()
        self._frame: CloudFrame | None = None
        """Of the first window, held so that cells do not move from tick to tick."""
        self._book = SharpnessBook(REMEMBERED)
        self._plumb = PlumbBook()
        self._views = ViewCounter()
        self.way: Float64 | None = None
        """(W, 3) where the vehicle was in the map [m], None unknown; as for ``Pipeline``."""

    @property
    def state(self) -> LiveState:
        """What is known, without the figures of a tick."""
        sharpness = self._judge()
        return LiveState(
            spans=self._registry.spans,
            supports=self._supports.supports,
            hazards=() if sharpness.poor else self._hazards.hazards,
            awaited=np.zeros((0, 3)) if sharpness.poor else self._hazards.awaited,
            sharpness=sharpness,
            corridor=self._corridor,
            around=self._surroundings.known,
        )

    def remember(self) -> Kept:
        """Return what is to be kept from tick to tick."""
        return Kept(
            spans=self._registry.remember(), hazards=self._hazards.remember(),
            supports=self._supports.remember(), spreads=self._book.remember(),
            leans=self._plumb.leans,
        )

    def restore(self, kept: Kept) -> None:
        """Go on from what a session kept; the corridor is empty until ticks find it again."""
        self._registry.restore(kept.spans)
        self._hazards.restore(kept.hazards)
        self._supports.restore(kept.supports)
        self._book.restore(kept.spreads)
        self._plumb.leans = kept.leans

    def tick(
        self, window: Window, settings: Settings, vehicle: Float64 | None,
        rules: RuleSet | None = None, looks: Sequence[LookWindow] = (),
    ) -> Tick:
        """
        Run the pipeline over a window and update what is known.

        Parameters
        ----------
        window : Window
            Part of the map.
        settings : Settings
            For the pipeline.
        vehicle : Float64 or None
            (2+,) where the vehicle is [m].
        rules : RuleSet or None
            Clearance rules, by default the plain ones of the settings.
        looks : sequence of LookWindow
            New points that tell how sharp the map is.

        Returns
        -------
        Tick
            Without hazards where the map is not sharp or upright.  Where it is hopeless nothing
            is looked for: what is known stays, and no labels are given.

        """
        started = time.perf_counter()
        if self.measure(window.points, looks).hopeless:
            return self._wait(window, started)
        self._frame = self._frame or find_cloud_frame(window.points)
        result, labels = _run(window.points, self._frame, settings, rules, self.way)
        self._plumb.add(measure_leans(window.points, result))
        self._views.advance(self.way)
        numbered = self._registry.update(
            result, window.points, window.spans, views=[
                int(self._views.count(sample_span(span, SPACING)).max()) for span in result.spans
            ],
        )
        expected = self._follow_renamed(window.spans)
        self._finish_spans(expected, vehicle)
        spans = [item.span for item in self._registry.spans if item.confirmed]
        keys = {(span.line_id, span.span_id) for span in spans}
        told = {old: new for old, new in numbered.items() if new in keys}
        supports = self._supports.update(result.supports, told, window.holds)
        news = HazardNews() if self._judge().poor else self._hazards.update(
            carry_numbers(result.hazards, told, supports), told, expected, window.holds,
            views=[int(self._views.count(item.position[None])[0]) for item in result.hazards],
        )
        news = self._hazards.clear_gone(news, spans)
        self._keep_corridor(result, window, numbered, vehicle)
        self._surroundings.update(
            [item.span for item in self._registry.spans], window, result, vehicle
        )
        return Tick(
            state=self._describe(news, result, window.sequence, started),
            labels=labels,
        )

    def measure(self, points: Float64, looks: Sequence[LookWindow]) -> Sharpness:
        """Take points (N, 3) and looks that tell how good the map is; return how good it is."""
        self._book.add(looks)
        self._plumb.look(points, self.way)
        return self._judge()

    def _judge(self) -> Sharpness:
        return self._plumb.judge(self._book.judge())

    def _wait(self, window: Window, started: float) -> Tick:
        state = replace(
            self.state, num_merges=self._registry.num_merges, sequence=window.sequence,
            seconds=time.perf_counter() - started,
        )
        return Tick(state=state, labels=np.zeros(0, dtype=np.uint8))

    def conclude(
        self, points: Float64, settings: Settings, sequence: int, *, complete: bool,
        rules: RuleSet | None = None, looks: Sequence[LookWindow] = (),
    ) -> tuple[LiveState, InspectionResult, UInt8]:
        """
        Run the pipeline over the whole map, and replace what is known by what it finds.

        Parameters
        ----------
        points : Float64
            (N, 3) all voxels of the map [m].
        settings : Settings
            For the pipeline.
        sequence : int
            Newest insertion of the map that is in.
        complete : bool
            Nothing was evicted from the map.  Otherwise finished spans that it no longer holds are
            kept, with their supports and hazards.
        rules : RuleSet or None
            As for ``tick``.
        looks : sequence of LookWindow
            As for ``tick``.

        Returns
        -------
        state : LiveState
        result : InspectionResult
            With the lasting numbers and the spans that were kept.
        labels : (N,) uint8
            For the map.

        """
        started = time.perf_counter()
        self.measure(points, looks)
        result, labels = _run(
            points, find_cloud_frame(points), settings, rules, self.way
        )
        self._plumb.add(measure_leans(points, result))
        known = [item.key for item in self._registry.spans]
        numbered = self._registry.update(
            result, points, known, final=True, complete=complete
        )
        self._follow_renamed(())
        seen = set(numbered.values()) if complete else set()
        holds = _hold_all if complete else _hold_none
        supports = self._supports.update(result.supports, numbered, holds, final=complete)
        news = HazardNews() if self._judge().poor else self._hazards.update(
            carry_numbers(result.hazards, numbered, supports), numbered, seen, holds,
            final=True, complete=complete,
        )
        news = self._hazards.clear_gone(news, [item.span for item in self._registry.spans])
        state = self._describe(news, result, sequence, started)
        final = replace(
            renumber(result, numbered),
            spans=tuple(item.span for item in state.confirmed),
            supports=state.supports,
            hazards=state.hazards,
        )
        return state, final, labels

    def _describe(
        self, news: HazardNews, result: InspectionResult, sequence: int, started: float
    ) -> LiveState:
        return replace(
            self.state,
            news=news,
            stages=result.stages,
            num_points=result.num_points,
            num_merges=self._registry.num_merges,
            sequence=sequence,
            seconds=time.perf_counter() - started,
        )

    def _follow_renamed(self, keys: Collection[SpanKey]) -> set[SpanKey]:
        """Rename what the registry has renamed in its update; return spans by their new keys."""
        renamed = self._registry.find_renamed
        self._hazards.follow(self._registry.find_heir)
        self._supports.follow(renamed)
        return {renamed(key) for key in keys}

    def _finish_spans(self, expected: Collection[SpanKey], vehicle: Float64 | None) -> None:
        if vehicle is None:
            return
        behind = []
        for item in self._registry.spans:
            if item.finished or item.key in expected:
                continue
            apart = sample_span(item.span, FINISHED_SPACING) - vehicle[:2]
            if float(np.hypot(apart[:, 0], apart[:, 1]).min()) > FINISHED_DISTANCE:
                behind.append(item.key)
        self._registry.finish(behind)

    def _keep_corridor(
        self,
        result: InspectionResult,
        window: Window,
        numbered: Mapping[SpanKey, SpanKey],
        vehicle: Float64 | None,
    ) -> None:
        """Replace the corridor in fresh cells; forget what is far from the vehicle."""
        kept = self._corridor
        stays = ~window.holds(kept.points)
        if vehicle is not None:
            apart = np.hypot(*(kept.points[:, :2] - vehicle[:2]).T)
            stays &= apart <= CORRIDOR_REACH
        kept = kept.select(stays)
        held = window.holds(window.points[result.corridor])
        chosen = result.corridor[held]
        line_id, span_id = map_numbers(
            result.corridor_line_id[held], result.corridor_span_id[held], numbered
        )
        new = CorridorPoints(
            points=window.points[chosen],
            classification=result.classification[chosen],
            clearance=result.clearance[chosen],
            line_id=line_id,
            span_id=span_id,
        ).select(line_id >= 0)
        self._corridor = CorridorPoints(
            points=np.concatenate((kept.points, new.points)),
            classification=np.concatenate((kept.classification, new.classification)),
            clearance=np.concatenate((kept.clearance, new.clearance)),
            line_id=np.concatenate((kept.line_id, new.line_id)),
            span_id=np.concatenate((kept.span_id, new.span_id)),
        )


def _run(
    points: Float64, frame: CloudFrame, settings: Settings, rules: RuleSet | None,
    way: Float64 | None,
) -> tuple[InspectionResult, UInt8]:
    """Return what the pipeline finds, and labels for the map."""
    own = frame.enter(points)
    flown = None if way is None else frame.enter(way)
    trace = Pipeline(settings, rules, flown).trace(own, east=frame.east)
    labels = label_points(own, trace.models, trace.result, settings, rules)
    return frame.leave_result(trace.result, trace.offending), labels


def _hold_all(points: Float64) -> Bool:
    return np.ones(len(points), dtype=np.bool_)


def _hold_none(points: Float64) -> Bool:
    return np.zeros(len(points), dtype=np.bool_)
