"""One compiled function that runs a generated system: servo ticks, Runge-Kutta substeps, rows of output.

It advances blocks of lanes (simulations that run side by side in one vector).

    run(first, last, timing, params, states, memories, currents, demands, demand_stride,
        rows, row_substep, row_weights, out)

Per block of ``width`` lanes and everything contiguous in lanes: params (P), states (X), memories (C), currents (2 n:
flowing, commanded), demands (ticks, n), out (rows, X + n); n counts joints and thrusters. A tick evaluates the servo
once; ``substeps`` classical Runge-Kutta steps follow, during which the currents of the joints approach the commands
with the exact solution of their first-order lag. Output rows lie anywhere in a substep: states by the cubic Hermite
polynomial of both ends (error h^4/384 of the fourth derivative), currents exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import ir

from arm_model.symbolic.codegen import DOUBLE, DOUBLES, INT, Precision, Vector, emit
from arm_model.symbolic.tape import Expr
from arm_model.system.closed_loop_system import System

VOID = ir.VoidType()
TIMING = ("step", "half_decay", "start", "ticks", "substeps")
"""Doubles of ``timing``: s; decay of a current's deviation over half a step; s at tick 0; counts."""
ROW = 5
"""Doubles per output row: Hermite weights of x0, x0', x1, x1' and the decay of the currents since the substep began."""


def module_of(system: System, params: tuple[Expr, ...], width: int, precision: Precision = DOUBLES) -> ir.Module:
    """The LLVM module with the function ``run``.

    ``params``: nodes that are given per lane (``arm_model.simulation.kernel_layout``). In single precision all arrays
    of lanes are of single precision; what a step adds to the states is summed with compensation (Kahan 1965), without
    which the rounding of thousands of small steps would add up.
    """
    return _Kernel(system, params, width, precision).module


class _Kernel:
    def __init__(self, system: System, params: tuple[Expr, ...], width: int, precision: Precision) -> None:
        self.system, self.params, self.width, self.precision = system, params, width, precision
        self.module = ir.Module(name="arm")
        self.lane = ir.VectorType(precision.real, width) if width > 1 else precision.real
        self.pointer = self.lane.as_pointer()
        self.rates = self._function("rates", [self.pointer] * 3 + [DOUBLE, self.pointer], self._emit_rates)
        self.servo = self._function("servo", [self.pointer] * 5, self._emit_servo)
        doubles, ints = DOUBLE.as_pointer(), INT.as_pointer()
        arguments = [INT, INT, doubles, *[self.pointer] * 5, INT, INT, ints, doubles, self.pointer]
        self._function("run", arguments, self._emit_run, internal=False)

    def _function(
        self, name: str, arguments: list[ir.Type], body: Callable[..., None], *, internal: bool = True
    ) -> ir.Function:
        function = ir.Function(self.module, ir.FunctionType(VOID, arguments), name)
        if internal:
            function.linkage = "internal"
            function.attributes.add("noinline")
            for argument in function.args:
                if isinstance(argument.type, ir.PointerType):
                    argument.add_attribute("noalias")
        builder = ir.IRBuilder(function.append_basic_block("entry"))
        body(builder, *function.args)
        builder.ret_void()
        return function

    @property
    def _compensated(self) -> bool:
        return self.precision.bits < 64

    def _load(self, builder: ir.IRBuilder, base: Any, index: Any) -> Any:
        where = builder.gep(base, [index if not isinstance(index, int) else INT(index)])
        return builder.load(where, align=8)

    def _store(self, builder: ir.IRBuilder, value: Any, base: Any, index: Any) -> None:
        where = builder.gep(base, [index if not isinstance(index, int) else INT(index)])
        builder.store(value, where, align=8)

    def _given(
        self, builder: ir.IRBuilder, sources: Sequence[tuple[Sequence[str], Any]], params: Any
    ) -> dict[int, Any]:
        """Node index -> load, of named inputs (in arrays of lanes) and of the params."""
        given: dict[int, Any] = {}
        for names, base in sources:
            for position, name in enumerate(names):
                index = self.system.tape.input(name).index
                given[index] = lambda base=base, position=position: self._load(builder, base, position)
        for position, expr in enumerate(self.params):
            given[expr.index] = lambda position=position: self._load(builder, params, position)
        return given

    def _names(self, name: str) -> list[str]:
        return [f"{name}{j}" for j in range(self.system.channels)]

    def _emit_rates(self, builder: ir.IRBuilder, x: Any, current: Any, params: Any, time: Any, out: Any) -> None:
        vector = Vector(builder, self.width, self.precision)
        given = self._given(builder, [(self.system.states, x), (self._names("current"), current)], params)
        given[self.system.tape.input("time").index] = lambda: vector.spread(time)
        for position, value in enumerate(emit(vector, self.system.tape, self.system.rates, given)):
            self._store(builder, value, out, position)

    def _emit_servo(self, builder: ir.IRBuilder, x: Any, memory: Any, demand: Any, params: Any, command: Any) -> None:
        system, vector = self.system, Vector(builder, self.width, self.precision)
        sources = [(system.states, x), (system.memories, memory), (self._names("demand"), demand)]
        values = emit(
            vector, system.tape, [*system.commands, *system.next_memories], self._given(builder, sources, params)
        )
        for position, value in enumerate(values):
            base, place = (command, position) if position < system.channels else (memory, position - system.channels)
            self._store(builder, value, base, place)

    def _loop(self, builder: ir.IRBuilder, first: Any, last: Any, body: Callable[[Any], None]) -> None:
        """for index in first..last-1: body(index)."""
        entry = builder.block
        head = builder.append_basic_block("head")
        inside = builder.append_basic_block("inside")
        after = builder.append_basic_block("after")
        builder.branch(head)
        builder.position_at_end(head)
        index = builder.phi(INT)
        index.add_incoming(first, entry)
        builder.cbranch(builder.icmp_signed("<", index, last), inside, after)
        builder.position_at_end(inside)
        body(index)
        index.add_incoming(builder.add(index, INT(1)), builder.block)
        # the increment stands in the last block of the body
        builder.branch(head)
        builder.position_at_end(after)

    def _emit_run(self, builder: ir.IRBuilder, *arguments: Any) -> None:
        given = _Arguments(*arguments)
        scalars = {name: builder.load(builder.gep(given.timing, [INT(k)])) for k, name in enumerate(TIMING)}
        ticks = builder.fptosi(scalars["ticks"], INT)
        room = {
            name: builder.alloca(self.lane, max(size, 1), name)
            for name, size in _room(self.system.channels, len(self.system.states)).items()
        }
        table = _RowTable(builder.alloca(INT, name="row"), given.row_substep, given.row_weights)

        def block(index: Any) -> None:
            lanes = self._lanes(builder, given, index)
            builder.store(INT(0), table.row)
            for k in range(len(self.system.states) if self._compensated else 0):
                self._store(builder, ir.Constant(self.lane, None), room["lost"], k)
            self._loop(builder, INT(0), ticks, lambda number: self._tick(builder, scalars, room, lanes, table, number))

        self._loop(builder, given.first, given.last, block)

    def _lanes(self, builder: ir.IRBuilder, given: _Arguments, index: Any) -> _Lanes:
        """The arrays of block ``index``."""
        n, nx, nc = self.system.channels, len(self.system.states), len(self.system.memories)

        def part(base: Any, size: Any) -> Any:
            return builder.gep(base, [builder.mul(index, size)])

        current = part(given.currents, INT(2 * n))
        return _Lanes(
            x=part(given.states, INT(nx)),
            memory=part(given.memories, INT(nc)),
            current=current,
            command=builder.gep(current, [INT(n)]),
            demand=part(given.demands, given.demand_stride),
            params=part(given.params, INT(len(self.params))),
            out=part(given.out, builder.mul(given.rows, INT(nx + n))),
        )

    def _tick(
        self,
        builder: ir.IRBuilder,
        scalars: dict[str, Any],
        room: dict[str, Any],
        lanes: _Lanes,
        table: _RowTable,
        number: Any,
    ) -> None:
        """Servo tick ``number``: the commands, then the substeps and their output rows."""
        n, nx = self.system.channels, len(self.system.states)
        demand = builder.gep(lanes.demand, [builder.mul(number, INT(n))])
        builder.call(self.servo, [lanes.x, lanes.memory, demand, lanes.params, lanes.command])
        substeps = builder.fptosi(scalars["substeps"], INT)
        # Without a lag the current equals its command at once; the lag is that of the joints' current loops.
        with builder.if_then(builder.fcmp_ordered("==", scalars["half_decay"], DOUBLE(0.0))):
            self._copy(builder, lanes.command, lanes.current, n)
        for k in range(self.system.joints, n):
            self._store(builder, self._load(builder, lanes.command, k), lanes.current, k)

        def substep(part: Any) -> None:
            step_number = builder.add(builder.mul(number, substeps), part)
            elapsed = builder.fmul(builder.sitofp(step_number, DOUBLE), scalars["step"])
            time = builder.fadd(elapsed, scalars["start"])
            self._step(builder, scalars, room, lanes, time)
            self._rows(builder, scalars, room, lanes, time, table, step_number)
            self._copy(builder, room["next"], lanes.x, nx)
            self._copy(builder, room["end"], lanes.current, n)

        self._loop(builder, INT(0), substeps, substep)

    def _copy(self, builder: ir.IRBuilder, source: Any, target: Any, count: int) -> None:
        for k in range(count):
            self._store(builder, self._load(builder, source, k), target, k)

    def _step(
        self, builder: ir.IRBuilder, scalars: dict[str, Any], room: dict[str, Any], lanes: _Lanes, time: Any
    ) -> None:
        """One classical Runge-Kutta step from x; room["next"] is its end, room["first"] the rates at its start."""
        vector = Vector(builder, self.width, self.precision)
        n, nx = self.system.channels, len(self.system.states)
        step = scalars["step"]
        half = builder.fmul(step, DOUBLE(0.5))
        decay = vector.spread(scalars["half_decay"])
        for k in range(n):
            target = self._load(builder, lanes.command, k)
            if k >= self.system.joints:
                self._store(builder, target, room["middle"], k)
                self._store(builder, target, room["end"], k)
                continue
            middle = vector.mul(vector.sub(self._load(builder, lanes.current, k), target), decay)
            self._store(builder, vector.add(target, middle), room["middle"], k)
            self._store(builder, vector.fused(middle, decay, target), room["end"], k)
        middle_time, end_time = builder.fadd(time, half), builder.fadd(time, step)
        stages = [
            (lanes.x, lanes.current, time, "first", half),
            (room["stage"], room["middle"], middle_time, "second", half),
            (room["stage"], room["middle"], middle_time, "third", step),
            (room["stage"], room["end"], end_time, "fourth", None),
        ]
        for source, flowing, moment, name, ahead in stages:
            builder.call(self.rates, [source, flowing, lanes.params, moment, room[name]])
            if ahead is not None:
                reach = vector.spread(ahead)
                for k in range(nx):
                    moved = vector.fused(self._load(builder, room[name], k), reach, self._load(builder, lanes.x, k))
                    self._store(builder, moved, room["stage"], k)
        sixth = vector.spread(builder.fmul(step, DOUBLE(1.0 / 6.0)))
        two = vector.constant(2.0)
        for k in range(nx):
            slopes = [self._load(builder, room[stage[3]], k) for stage in stages]
            total = vector.fused(vector.add(slopes[1], slopes[2]), two, vector.add(slopes[0], slopes[3]))
            x = self._load(builder, lanes.x, k)
            if not self._compensated:
                self._store(builder, vector.fused(total, sixth, x), room["next"], k)
                continue
            added = vector.fused(total, sixth, self._load(builder, room["lost"], k))
            reached = builder.fadd(x, added)
            self._store(builder, builder.fsub(added, builder.fsub(reached, x)), room["lost"], k)
            self._store(builder, reached, room["next"], k)

    def _rows(
        self,
        builder: ir.IRBuilder,
        scalars: dict[str, Any],
        room: dict[str, Any],
        lanes: _Lanes,
        time: Any,
        table: _RowTable,
        step_number: Any,
    ) -> None:
        """Writes the output rows that lie in this substep; the rates at its end are evaluated only if there are any."""
        vector = Vector(builder, self.width, self.precision)
        n, nx = self.system.channels, len(self.system.states)
        with builder.if_then(self._due(builder, table, step_number)):
            end_time = builder.fadd(time, scalars["step"])
            builder.call(self.rates, [room["next"], room["end"], lanes.params, end_time, room["second"]])
            head = builder.append_basic_block("row")
            after = builder.append_basic_block("rows_done")
            builder.branch(head)
            builder.position_at_end(head)
            number = builder.load(table.row)
            first = builder.mul(number, INT(ROW))
            weights = [
                vector.spread(builder.load(builder.gep(table.weights, [builder.add(first, INT(k))])))
                for k in range(ROW)
            ]
            target = builder.gep(lanes.out, [builder.mul(number, INT(nx + n))])
            for k in range(nx):
                ends = [self._load(builder, base, k) for base in (lanes.x, room["first"], room["next"], room["second"])]
                value = vector.mul(ends[0], weights[0])
                for end, weight in zip(ends[1:], weights[1:]):
                    value = vector.fused(end, weight, value)
                self._store(builder, value, target, k)
            for k in range(n):
                wanted = self._load(builder, lanes.command, k)
                if k >= self.system.joints:
                    self._store(builder, wanted, target, nx + k)
                    continue
                deviation = vector.sub(self._load(builder, lanes.current, k), wanted)
                self._store(builder, vector.fused(deviation, weights[4], wanted), target, nx + k)
            builder.store(builder.add(number, INT(1)), table.row)
            builder.cbranch(self._due(builder, table, step_number), head, after)
            builder.position_at_end(after)

    def _due(self, builder: ir.IRBuilder, table: _RowTable, step_number: Any) -> Any:
        """Whether the next output row lies in this substep; the table ends with one that never comes."""
        lies = builder.load(builder.gep(table.substep, [builder.load(table.row)]))
        return builder.icmp_signed("==", lies, step_number)


@dataclass(frozen=True)
class _Arguments:
    """Arguments of ``run``, in its order; pointers to the first block's values."""

    first: Any
    last: Any
    timing: Any
    params: Any
    states: Any
    memories: Any
    currents: Any
    demands: Any
    demand_stride: Any
    rows: Any
    row_substep: Any
    row_weights: Any
    out: Any


@dataclass(frozen=True)
class _Lanes:
    """Pointers to one block's values."""

    x: Any
    memory: Any
    current: Any
    command: Any
    demand: Any
    params: Any
    out: Any


@dataclass(frozen=True)
class _RowTable:
    """Pointers: number of the next row, substep of every row, its weights."""

    row: Any
    substep: Any
    weights: Any


def _room(n: int, nx: int) -> dict[str, int]:
    """Scratch arrays of one step: rates of the four stages, states in between and at the end, currents."""
    names = ("first", "second", "third", "fourth", "stage", "next", "lost")
    return dict.fromkeys(names, nx) | {"middle": n, "end": n}
