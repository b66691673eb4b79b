# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The onboard node.

The executor's thread owns the poses, the scans that wait and the map; it copies what a tick
needs in small steps, so that callbacks are never kept waiting.  The process of the ticks runs the
pipeline over the copy and builds the messages, which the executor's thread then sends.
"""

from collections.abc import Callable, Iterator
from functools import partial
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from plc_inspect.config import Settings
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.session import LiveState, Session
from plc_inspect.core.live.told_state import move_state
from plc_inspect.core.live.warm_up import warm_up_intake
from plc_inspect.core.live.window import copy_window, Window, WindowPlan
from plc_inspect.errors import DataError
from plc_inspect.flight_record.recording import PERIOD
from plc_inspect.offline.records.flight import Flight
from plc_inspect.ros.background import tick_job
from plc_inspect.ros.background.tick_job import Done
from plc_inspect.ros.background.tick_process import TickProcess
from plc_inspect.ros.graph.ending import survive
from plc_inspect.ros.graph.guard import Guard
from plc_inspect.ros.graph.qos import DIAGNOSTICS, watched
from plc_inspect.ros.graph.requests import refuse, Requests
from plc_inspect.ros.graph.voices import Voices
from plc_inspect.ros.node import jobs
from plc_inspect.ros.node.complaints import Complaints
from plc_inspect.ros.node.diagnostics import (
    describe_input,
    describe_map,
    describe_record,
    describe_segmentation,
    Health,
    sign,
)
from plc_inspect.ros.node.doubt import KnownStates
from plc_inspect.ros.node.intake import Intake
from plc_inspect.ros.node.keeper import Keeper
from plc_inspect.ros.node.parameters import Parameters
from plc_inspect.ros.node.subscriptions import Subscriptions
from plc_inspect.ros.node.watch import InputWatch, SourceWatch
from plc_inspect.ros.node.worker import Worker
from plc_inspect.ros.results.keep_out import KeepOut
from plc_inspect.ros.results.publishing import make_bundle, ResultPublishers
from plc_inspect.ros.results.teller import summarize, Teller
from plc_inspect.ros.results.thin_link import Stream

NODE_NAME = 'plc_inspect'
STOP_TIMEOUT = 30.0
"""Longest wait for the running job at the end [s]."""


class InspectNode(Node):
    """
    Scans and odometry in, conductors and hazards out.

    Parameters
    ----------
    ticks : TickProcess or None
        Runs ticks, and belongs to the node from now on; None: the worker thread runs them.
    **options
        Of rclpy's Node, such as ``context`` and ``parameter_overrides``.

    Raises
    ------
    ConfigError
        A parameter is unknown, of the wrong type or out of range.

    """

    def __init__(self, ticks: TickProcess | None = None, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self._ticks: Any = ticks or tick_job
        try:
            self._set_up()
        except BaseException:
            self.destroy_node()
            raise

    def _set_up(self) -> None:
        self._live_parameters = Parameters(self, self._configure)
        settings = self.settings
        self._door = Guard(settings.security)
        warm_up_intake()
        self._health, self._log = Health(), Voices(self.get_logger())
        self._intake = Intake(settings, self._health, self._log.warning)
        self._planner = make_planner(settings, self._live_parameters.rules)
        self._session = Session()
        self._known = KnownStates(self._session.state)
        self._copy: tuple[Iterator[Window | None], str] | None = None
        self._job, self._wants_tick = '', False
        self._rest: list[Any] = []
        self._complaints = Complaints(self._log.warning)
        self._teller = Teller(self._log.info, self._log.warning)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._stream = Stream(self, lambda: self.settings.stream, self._intake, self._guard)
        self._results = ResultPublishers(self, self._stream)
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', DIAGNOSTICS, **watched(self, 'diagnostics')
        )
        self._advance_guard = self.create_guard_condition(self._guard('step', self._advance))
        self._worker = Worker(self._advance_guard.trigger)
        self._sources = Subscriptions(
            self, settings.input, self._intake, self._guard, self._on_message_lost
        )
        self._segmenting = Requests(self, 'segment', self._advance_guard.trigger)
        self._saving = Requests(self, 'save', self._advance_guard.trigger)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._timer = self.create_timer(
            settings.segment.period, self._guard('timer', self._on_timer), clock=self._steady
        )
        self.create_timer(1.0, self._guard('diagnostics', self._on_second), clock=self._steady)
        self._jump_handle = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
            ),
            post_callback=self._on_clock_jump,
        )
        self._watch = InputWatch(
            self, (settings.input.scan_topic, settings.input.odometry_topic), time.monotonic()
        )
        self._intake.on_restart = self._on_map_restart
        scans = self.resolve_topic_name(settings.input.scan_topic)  # counting does not remap
        self._intake.accepts = SourceWatch(lambda: self.count_publishers(scans)).accepts
        keep_out = KeepOut(self, lambda: (self.state, self.settings), self._stream.tell_nearness)
        self._intake.on_pose = keep_out.tell
        self._submit('start', partial(self._ticks.prepare, settings))
        self._keeper = Keeper(
            settings, self._live_parameters.rules, self._intake, self._log, self._forget
        )
        if self._keeper.resume(self._session):
            self._known.add(0, known := self._session.state)
            self._publish(known, self._intake.accumulator.frame_id)
            self._teller.tell(known)
        self.create_timer(PERIOD, self._guard('record', self._keeper.step), clock=self._steady)

    @property
    def settings(self) -> Settings:
        """The settings that hold now."""
        return self._live_parameters.settings

    @property
    def health(self) -> Health:
        """Counts and times."""
        return self._health

    @property
    def state(self) -> LiveState | None:
        """What was published last, None before the first tick."""
        return self._known.state

    @property
    def intake(self) -> Intake:
        """Poses, waiting scans and the map; for the executor's thread only."""
        return self._intake

    def _guard(self, name: str, callback: Callable[..., None]) -> Callable[..., None]:
        """Time a callback, and keep the node alive if it fails."""
        def run(*arguments: Any) -> None:
            with self._health.measure(name):
                survive(partial(callback, *arguments), partial(self._fail, name), self.context)

        # The executor looks at the number of parameters of a subscription's callback.
        if name == 'scan':
            return lambda message, info: run(message, info)
        timed = name in ('step', 'timer', 'diagnostics', 'stream', 'record')
        return (lambda: run()) if timed else (lambda message: run(message))

    def _fail(self, where: str, error: Exception) -> None:
        self._health.last_error = f'{where}: {type(error).__name__}: {error}'
        self._complaints.complain(where, f'failed in {self._health.last_error}')
        if where == 'step':  # no job begins that would answer
            refuse(self._health.last_error, self._segmenting, self._saving)

    def _on_message_lost(self, event: Any) -> None:
        self._health.messages_lost += event.total_count_change

    def _on_clock_jump(self, jump: TimeJump) -> None:
        self._health.num_clock_jumps += 1
        self._intake.accumulator.reset(keep_map=True)
        self._complaints.complain('clock', (
            f'time jumped by {jump.delta.nanoseconds * 1e-9:.3f} s: poses and waiting scans were '
            'reset, the map was kept; call ~/reset to forget it too'
        ))

    def _configure(self, settings: Settings) -> None:
        """Put changed settings to work, all at once."""
        self._intake.accumulator.configure(settings)
        self._planner = make_planner(settings, self._live_parameters.rules)
        self._keeper.configure(settings, self._live_parameters.rules)
        period_ns = round(settings.segment.period * 1e9)
        if self._timer.timer_period_ns != period_ns:  # it begins anew, which puts a tick off
            self._timer.timer_period_ns = period_ns
            self._timer.reset()

    def _on_timer(self) -> None:
        self._health.num_postponed += self._wants_tick
        self._wants_tick = True
        self._advance_guard.trigger()

    def _on_second(self) -> None:
        now = time.monotonic()
        self._health.hints = self._sources.look()
        lossy = self._intake.report_losses()
        counters = self._intake.accumulator.counters()
        status = [
            describe_input(
                counters, self._health, now, lossy,
                self._watch.look(counters, self._health, self.settings.input, now),
            ),
            describe_map(
                self._intake.accumulator.map, self._intake.evictor.num_evicted,
                self._intake.count_refused(counters), self._intake.doubt, self.state,
                getattr(self._ticks, 'pid', None),
            ),
            describe_segmentation(self.state, self._health, self._worker.busy),
            self._door.describe(),
            describe_record(self._keeper.describe()),
        ]
        sign(status, self.get_fully_qualified_name())
        header = Header(stamp=self.get_clock().now().to_msg())
        self._diagnostics.publish(DiagnosticArray(header=header, status=status))
        self._stream.tell_health(status)

    def _on_reset(self, request: Trigger.Request, response: Any) -> Any:
        try:
            self._forget('the node was reset', lose=False)
        except DataError as error:
            response.success, response.message = False, f'not reset: {error}'
            return response
        self._intake.reset()
        self._log.info('reset: map, lines and hazards are forgotten')
        response.success, response.message = True, 'map, lines and hazards are forgotten'
        return response

    def _on_map_restart(self) -> None:
        """Save what was found in the map that was given up, and begin anew."""
        self._log.error(f'{self._intake.accumulator.entry.cause}: the map begins anew')
        self._forget('the map began anew')

    def _forget(self, reason: str, *, lose: bool = True) -> None:
        """Save what was found and forget it, and whatever is being worked on."""
        if kept := jobs.keep_state(self._describe_flight(), self.state, reason, lose=lose):
            self._log.error(kept)
        self._session = Session()
        self._copy = None
        if self._job in ('tick', 'save'):
            self._job = 'discarded'
        self._known = KnownStates(self._session.state)
        self._teller.clear()
        refuse(reason, self._segmenting, self._saving)
        self._keeper.forget()
        self._stream.forget()
        self._publish(self._session.state, '')

    def _publish(self, state: LiveState, frame_id: str) -> None:
        told, now = move_state(state, self._intake.move.inverse()), self.get_clock().now()
        bundle = make_bundle(told, frame_id, now.nanoseconds, self.settings.stream)
        self._results.publish(bundle, kept=not self._health.num_ticks)

    def _submit(self, job: str, work: Callable[[], Any]) -> None:
        self._job = job
        self._worker.submit(work)

    def _advance(self) -> None:
        """Take up what the worker finished; give it what is due; copy a little for it."""
        outcome = self._worker.take()
        if outcome is not None:
            job, self._job = self._job, ''
            self._finish(job, outcome.value, outcome.error)
        if self._copy is not None:
            self._step_copy(*self._copy)
        elif not self._worker.busy:
            self._begin()

    def _begin(self) -> None:
        """Start a save or a tick, if one is wanted, else what there is time for now."""
        if doubt := self._intake.doubt:
            self._wants_tick = False
            refuse(doubt, self._segmenting, self._saving)
            if held := self._known.hold_back(self._intake.accumulator):
                self._publish(held, self._intake.accumulator.frame_id)
        if self._saving and not len(self._intake.accumulator.map):
            refuse('nothing to save: the map is empty', self._saving)
        elif self._saving.take():
            self._copy_out(jobs.plan_save(self._intake, self.state), 'save')
        elif (asked := self._segmenting.take()) or self._wants_tick:
            plan = jobs.plan_tick(self._planner, self._intake, self.state, asked)
            self._wants_tick = False
            if plan is None:
                self._segmenting.answer(True, 'nothing is new since the last tick')
            else:
                self._copy_out(plan, 'tick')
        elif self._rest:
            self._submit('rest', partial(self._rest.pop(0).prepare, self.settings, rare=True))

    def _copy_out(self, plan: WindowPlan, job: str) -> None:
        if job == 'tick':
            self._intake.owed.begin(self._intake.accumulator.map.cells.index[plan.fresh])
        self._copy = copy_window(self._intake.accumulator.map, plan), job
        self._advance_guard.trigger()

    def _step_copy(self, copy: Iterator[Window | None], job: str) -> None:
        self._copy = None  # also where the next line fails
        if (window := next(copy)) is None:
            self._copy = copy, job
            self._advance_guard.trigger()
            return
        snapshot = jobs.take_snapshot(self._intake, window, self._describe_flight())
        run = jobs.run_save if job == 'save' else self._ticks.run_tick
        self._submit(job, partial(run, self._session, snapshot))

    def _describe_flight(self) -> Flight:
        return jobs.take_flight(self._intake, self.settings, self._live_parameters.rules)

    def _finish(self, job: str, done: Done | None, error: Exception | None) -> None:
        """Publish what the worker found, or say what went wrong."""
        if job == 'discarded':
            return
        if job == 'start':
            self._intake.take_memory()
            self._health.preparing = None
            self._rest = [tick_job] if self._ticks is tick_job else [self._ticks, tick_job]
            if error is None:
                self._log.info('ready')
        elif job == 'tick':
            in_vain = done is not None and done.state.sharpness.poor
            cells = self._intake.accumulator.map.cells
            self._intake.owed.end(cells, failed=done is None, in_vain=in_vain)
        if error is not None:
            self._health.num_failed += job == 'tick'
            self._fail(job, error)
            (self._saving if job == 'save' else self._segmenting).answer(False, str(error))
        if done is None:
            return
        self._session = done.session
        self._intake.accumulator.map.label(done.slots, done.points, done.labels)
        self._known.add(self._intake.accumulator.last_inserted or 0, done.state)
        self._keeper.keep(done.kept)
        self._results.publish(done.bundle, kept=self._health.last_scan is None)
        self._teller.tell(done.state)
        if done.state.sharpness.poor:
            self._complaints.complain('sharpness', done.state.sharpness.describe())
        if done.saved is not None:
            (self._log.error if done.saved.problem else self._log.info)(done.saved.describe())
            self._saving.answer(done.saved.folder is not None, done.saved.describe())
        else:
            self._health.num_ticks += 1
            self._segmenting.answer(not done.state.sharpness.hopeless, summarize(done.state))

    def close(self, *, save: bool = True) -> bool:
        """
        Stop the worker, let its job end, and write the results; call once, after spinning.

        Parameters
        ----------
        save : bool
            Write the results folder if anything came in.

        Returns
        -------
        bool
            Whether all that there is was written.

        """
        self._intake.leave_memory()
        stopped = self._worker.stop(STOP_TIMEOUT)
        if self._ticks is not tick_job:
            self._ticks.close()
        if not save or not len(self._intake.accumulator.map):
            self._keeper.close(None, wanted=False)
            if not save:
                return True
            lost = self._intake.explain_nothing()
            (self._log.error if lost else self._log.info)('nothing to save' + lost)
            return not lost
        self._keeper.flush()
        late = '' if stopped else f'the running job did not end within {STOP_TIMEOUT:g} s'
        self._known.hold_back(self._intake.accumulator)
        final = jobs.FinalSave(self._log.info, self._log.error)
        whole = final.save(self._session, self._intake, self._describe_flight(), self.state, late)
        self._keeper.close(final.saved)
        return whole
