"""The sampler: one acquisition, from arming to the last row.

    with open_bench(rig) as bench:
        acquisition = Acquisition(bench, experiment)
        for rows in acquisition.rows():
            recorder.write(rows)
        print(acquisition.ending, acquisition.ledger.summary())

Every block period all devices are read, each device's rows get their trigger's index
(``daq.acquisition.trigger_index``), the join makes complete rows (``daq.acquisition.join``), calibration makes them
angles and currents. No step loops over samples.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault, InputError
from daq.acquisition.clock_fit import ArrivalClock, ClockFit, fit_clock
from daq.acquisition.end_watch import PATIENCE, EndWatch
from daq.acquisition.join import Join, Joined
from daq.acquisition.ledger import Ledger
from daq.acquisition.readers import Intake
from daq.acquisition.rows import Rows, without_value
from daq.acquisition.states import NEXT, End, Ending, State
from daq.acquisition.tracker_memory import merge_points
from daq.rig.bench import Bench
from daq.rig.calibration import currents, of_another_time, positions, without_position
from daq.rig.preflight import check_plan
from drivers.protocols import ClockReadings, EdgeSource, Plan, PositionTracker
from experiment import Experiment, demand_of

RATE_TOLERANCE = 0.01
"""Relative: a trigger that is further off the rig's rate is noted."""
START_WINDOW = 0.002
"""s that the start signal may take; the demand's times are known to half of it."""
START_TOLERANCE = 0.05
"""rad (m): how far the first row may be from the experiment's start pose."""


class Acquisition:
    """One run on an open bench.

    experiment  the motion, or None: only to look
    seconds     how long, where there is no experiment (None: until stopped)
    state       idle, armed, running, done or fault; ``ending`` says why, once it has ended
    ledger      triggers, rows and losses; a recorder adds what it wrote and lost
    notes       sentences worth keeping about this run that are no losses
    """

    def __init__(self, bench: Bench, experiment: Experiment | None = None, *, seconds: float | None = None) -> None:
        self.bench, self.experiment = bench, experiment
        rate = experiment.rate if experiment is not None and experiment.rate is not None else bench.trigger.rate
        if experiment is not None:
            seconds = demand_of(experiment).duration
        self.plan = Plan(
            EdgeSource(bench.trigger.source),
            rate,
            None if seconds is None else max(round(seconds * rate), 1),
            bench.rig.block_seconds,
        )
        self.ledger = Ledger()
        self.state = State.IDLE
        self.ending: Ending | None = None
        self.notes: list[str] = []
        self.rows_made = 0
        self.missing: Counter[str] = Counter()
        self.started_ns = 0
        self._wall_offset = 0
        self._first = (0, 0)
        self._pace_ns = 1e9 / rate
        self._watch = EndWatch(bench, self.plan, moves=experiment is not None)
        self._held: list[Rows] = []
        self._make_join()

    # States

    def arm(self) -> None:
        """Checks rig, plan and motion, brings the arm to its start, sets the counters, and arms every device.

        Raises InputError where the run asks for more than the rig can do, DeviceFault where a device refuses.
        """
        bench = self.bench
        self._go(State.ARMED)
        try:
            problems = check_plan(bench.rig, bench.devices, bench.identities, self.plan)
            if problems:
                more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
                raise InputError(bench.rig.name, problems[0] + more)
            if self.experiment is not None:
                bench.guard.load(self.experiment)
                bench.zero(np.array(self.experiment.start), only_start=True)
            self._make_join()
            self._intake.arm()
        except BaseException:
            self._disarm()
            self.state = State.IDLE
            raise

    def disarm(self) -> None:
        """Back to idle, from armed. One that has ended is disarmed already and stays as it ended."""
        if self.ending is not None:
            return
        self._go(State.IDLE)
        self._disarm()

    def start(self) -> None:
        """Starts clock and arm: the start signal goes out, and each edge that comes back makes a row."""
        clock = self.bench.clock
        self._go(State.RUNNING)
        self._wall_offset = clock.wall_ns() - clock.monotonic_ns()
        try:
            self._intake.arm_afresh()
            self._join.begin_at(clock.monotonic_ns())
            before, after = self.bench.guard.start(motion=self.experiment is not None)
        except BaseException as error:
            self._end(Ending(End.DEVICE_LOST, str(error)))
            raise
        self.started_ns = (before + after) // 2
        self._watch.begin(after)
        if self.experiment is not None and after - before > START_WINDOW * 1e9:
            late = 0.5e-6 * (after - before)
            self.notes.append(f"the start signal took {2 * late:.2g} ms: the demand's times are known to {late:.2g} ms")
        self._intake.start(after)

    def stop(self, reason: End = End.STOPPED, detail: str = "") -> None:
        """Ends the run with the rows of the triggers so far; from any thread."""
        self._watch.stop(Ending(reason, detail))

    def _stop_at_once(self, reason: End, detail: str) -> None:
        """Ends the run with all outputs safe now, without waiting for other devices or the consumer of the rows."""
        self.bench.guard.make_safe()
        self.stop(reason, detail)

    @property
    def progress(self) -> float | None:
        """Share of the expected rows that have been made, 0..1; None for a run without an end."""
        return None if self.plan.rows is None else min(self.rows_made / self.plan.rows, 1.0)

    def clocks(self) -> list[ClockFit]:
        """The fit of each device's clock to the host's in this run: from clock readings if enough, else from rows."""
        fits = []
        for stream in self._intake.streams:
            device = self.bench.devices[stream.name]
            readings = device.clock_readings() if isinstance(device, ClockReadings) else []
            fits.append(fit_clock(stream.name, readings) or fit_clock(stream.name, stream.pairs.kept))
        return [fit for fit in fits if fit is not None]

    # Rows

    def rows(self) -> Iterator[Rows]:
        """Arms and starts if that was not done, and yields all rows, block by block, until the run has ended.

        When the loop ends, ``ending`` says why and the ledger balances. Whatever happens - the loop is left, the
        consumer raises - the outputs are in their safe state and the devices disarmed.
        """
        if self.state is State.IDLE:
            self.arm()
        if self.state is State.ARMED:
            self.start()
        try:
            while True:
                self._intake.sleep()
                last, ending = self._cycle()
                if ending is None:
                    yield from self._finished(self._join.take())
                    self.bench.guard.feed()
                    continue
                yield from self._tail(last, ending)
                return
        finally:
            self._end(Ending(End.ABANDONED))

    def _cycle(self) -> tuple[int, Ending | None]:
        """Reads every device once; the last trigger of the run and why it ends, if it does."""
        asked = self.bench.clock.monotonic_ns()  # taken before reading, in case the host is suspended in it
        for stream in self._intake.streams:
            if stream.name in self._join.gone:
                continue
            try:
                with self.bench.guard.awaiting(stream.name):
                    self._intake.read(stream)
            except DeviceFault as fault:
                self._stop_at_once(End.DEVICE_LOST, str(fault))
                self._join.lose_device(stream.name, fault.what)
        self._join.rebase()
        return self._clock.newest, self._watch.judge(asked, self._intake, self._join)

    def _tail(self, last: int, ending: Ending) -> Iterator[Rows]:
        """The rows up to the last trigger: waits for devices that are late, then gives up what is missing."""
        self.bench.guard.make_safe()
        if ending.reason is End.ROWS_DONE and self.plan.rows is not None:
            last = self.plan.rows - 1
        deadline = self.bench.clock.monotonic_ns() + PATIENCE * 1e9
        while self._intake.behind(last, self._join.gone) and self.bench.clock.monotonic_ns() < deadline:
            self._intake.sleep()
            self._cycle()
        self._intake.finish()
        if ending.state is State.FAULT:
            last = max(last, self._clock.newest)
        yield from self._finished(self._join.take(last))
        if self._intake.recalled is not None:
            tracker = cast(PositionTracker, self.bench.devices[self._intake.recalled.name])
            yield from merge_points(self._held, tracker.recall(), self.plan, self.notes)
        self._note_oddities()
        self._end(ending)

    def _finished(self, joined: Joined | None) -> Iterator[Rows]:
        """Calibrated rows, while the arm is watched."""
        if joined is None:
            return
        rows = self._calibrated(joined)
        if self.rows_made == 0:
            self._first = int(rows.number[0]), int(rows.host_ns[0])
            self._check_first(rows)
        self._pace_ns = (int(rows.host_ns[-1]) - self._first[1]) / max(int(rows.number[-1]) - self._first[0], 1)
        unmeasured = without_position(self.bench.calibration, rows.quality)
        untimed = of_another_time(self.bench.calibration, rows.quality)
        breach = self.bench.guard.breach(rows.q, rows.i, rows.host_ns, unmeasured, untimed)
        if breach is not None:
            self._stop_at_once(End.LIMIT, breach)
        self.rows_made += len(rows)
        self.missing.update(without_value(self.bench.columns, rows))
        if self._intake.recalled is None:
            yield rows
        else:  # complete once the tracker's memory has been read, at most so many rows as that holds
            self._held.append(rows)

    def _calibrated(self, joined: Joined) -> Rows:
        host: NDArray[np.int64] = joined.host
        if self._clock.indexer.regular is False and not self._clock.by_time:
            host = self._arrivals.times(joined.number, host)
        demand = None
        if self.experiment is not None and self.bench.guard.controller is not None:
            demand = self.bench.guard.controller.demand(np.asarray((host - self.started_ns) * 1e-9, float))
        calibration = self.bench.calibration
        return Rows(
            number=joined.number,
            host_ns=host,
            wall_ns=host + self._wall_offset,
            tick=joined.tick,
            counts=joined.counts,
            volts=joined.volts,
            quality=joined.quality,
            q=positions(calibration, joined.counts, joined.quality),
            i=currents(calibration, joined.volts),
            points=joined.points,
            qref=demand,
            extra={name: joined.readings[:, k] for k, (_, name) in enumerate(self.bench.columns.readings)},
        )

    def _make_join(self) -> None:
        """Creates readers and join; called again when the counters have been preset for the run."""
        period = 1.0 / self.plan.rate
        self._intake = Intake(self.bench, self.plan)
        self._clock = self._intake.clock
        patience = max(round(PATIENCE * self.plan.rate / 5), 2)
        self._join = Join(
            self._clock, self._intake.others, self.bench.columns, self.ledger, period * 1e9, patience, self.notes
        )
        self._arrivals = ArrivalClock(period * 1e9)

    # Ends

    def _check_first(self, rows: Rows) -> None:
        """A joint that does not read the start pose was never referenced, or shows a stale value."""
        if self.experiment is None:
            return
        measured = ~without_position(self.bench.calibration, rows.quality)
        first = rows.q[np.argmax(measured, axis=0), np.arange(measured.shape[1])]
        near = np.abs(first - np.array(self.experiment.start)) <= START_TOLERANCE
        for joint in np.flatnonzero(measured.any(axis=0) & ~near):
            self._stop_at_once(
                End.LIMIT,
                f"joint {joint + 1} reads {first[joint]:.4g} at the start, the experiment starts at "
                f"{self.experiment.start[joint]:.4g}: zero the encoders, or give them preset = 'start'",
            )

    def _note_oddities(self) -> None:
        """Adds notes about irregularities of this run that are not losses."""
        self.notes += self._intake.oddities()
        if self._clock.newest > 20 and abs(self._pace_ns * self.plan.rate * 1e-9 - 1) > RATE_TOLERANCE:
            self.notes.append(f"triggers came at {1e9 / self._pace_ns:.4g}/s where {self.plan.rate:g}/s were expected")

    def _go(self, state: State) -> None:
        if state not in NEXT[self.state]:
            raise DeviceFault(self.bench.rig.name, f"is {self.state}; it cannot become {state} from there")
        self.state = state

    def _end(self, ending: Ending) -> None:
        if self.state not in (State.ARMED, State.RUNNING):
            return
        self.ending, self.state = ending, ending.state
        self.bench.guard.make_safe()
        self._disarm()

    def _disarm(self) -> None:
        self.notes += self._intake.disarm()
