"""How fast an arm is simulated under its servos, against other simulators of the same arm on the same move.

    python -m benchmarks.simulation [--json]

NAME_x_real_time: simulated seconds (of all parameter sets together) a second of wall time. ours_vs_PEER: ratios of
these; ours runs again in turns with each batch, and the best of each counts, so that another load of the machine
changes little. cpu_NAME: the same of processor time over all threads, which another load changes least. differs_PEER:
largest difference of a joint angle from ours, rad. Needs the extra "bench"; peers that do not import are left out.
MuJoCo's batch (mujoco.rollout, two threads) runs open loop without friction, which is the most it can do at once in C.

peak_gflops: fused multiply-adds on all cores, measured in the same run (benchmarks/peak_rate.py). NAME_operations: of
one Runge-Kutta step; NAME_share_of_peak: operations per second of 1000 sets over the peak. six_over_three,
water_over_dry, floating_over_fixed: processor time of 1000 sets over that of three dry links on a fixed base.
single_vs_double: speed in single over that in double precision; differs_single: largest difference of a joint angle
after 10 s, rad.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from arm_io.parallel import cores
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.simulation.lanes import prepared
from arm_model.simulation.servo_references import references, row_times, servo_period
from arm_model.simulation.simulation import simulate, simulate_at, simulate_batch
from arm_model.symbolic.machine_code import lanes
from arm_model.tables.link_shapes import Cylinder
from benchmarks import simulation_peers as peers
from benchmarks.peak_rate import operations_a_step, peak_rate
from benchmarks.pendulum import double_pendulum, timed
from benchmarks.report import report

MODELS = Path(__file__).resolve().parent.parent / "config" / "models"
SETS = 1000
Result = TypeVar("Result")
CYLINDER = Cylinder(start=(-0.3, 0.0, 0.0), end=(0.0, 0.0, 0.0), radius=0.05)


def first_joints(arm: Arm, n: int) -> Arm:
    controller = arm.controller
    assert controller is not None and controller.natural_frequency and controller.inertia_pose
    frequency, pose = controller.natural_frequency[:n], controller.inertia_pose[:n]
    return replace(
        arm, joints=arm.joints[:n], controller=replace(controller, natural_frequency=frequency, inertia_pose=pose)
    )


def move(n: int) -> Callable[[Array], Array]:
    """Back and forth, all joints, a second each way."""
    reach = np.array([0.8, 0.6, -0.7, 0.5, 0.4, -0.6])[:n]
    return lambda t: np.outer((1 - np.cos(np.pi * t)) / 2, reach)


def variations(sets: int) -> dict[str, Array]:
    return {"joint2.viscous": np.linspace(6.0, 14.0, sets), "link3.mass": np.linspace(4.0, 6.0, sets)}


def ours(figures: dict[str, float], puma: Arm) -> None:
    for n, name in ((3, "three_links"), (6, "six_links")):
        arm = first_joints(puma, n)
        seconds, _ = timed(lambda a=arm, n=n: simulate(a, move(n), duration=20.0, rate=100))
        figures[f"{name}_one_x_real_time"] = 20.0 / seconds
        sets = variations(SETS)
        seconds, _ = timed(
            lambda a=arm, n=n, sets=sets: simulate_batch(a, move(n), row_times(5.0, 20), parameters=sets)
        )
        figures[f"{name}_1000_sets_x_real_time"] = 5.0 * SETS / seconds


def at_the_limit(figures: dict[str, float], puma: Arm) -> None:
    """Share of the machine's peak, and what more links, water and a floating base cost."""
    peak = peak_rate()
    figures["peak_gflops"] = peak / 1e9
    for n, name in ((3, "three_links"), (6, "six_links")):
        run = prepared(first_joints(puma, n), variations(lanes(64)), np.zeros(n), None)
        figures[f"{name}_operations"] = operations_a_step(run.program.system, run.program.params, run.substeps[0])
        rate = figures[f"{name}_1000_sets_x_real_time"] * run.substeps[0] / run.period
        figures[f"{name}_share_of_peak"] = figures[f"{name}_operations"] * rate / peak
    dry = first_joints(puma, 3)
    wet = replace(dry, joints=tuple(replace(joint, cylinder=CYLINDER) for joint in dry.joints))
    floating = replace(dry, floating=read_model(MODELS / "rov_arm.toml").floating)
    arms = {"dry": dry, "six": first_joints(puma, 6), "water": wet, "floating": floating}
    seconds = dict.fromkeys(arms, np.inf)
    for _ in range(5):  # in turns, the best of each, processor time
        for name, arm in arms.items():
            task = partial(simulate_batch, arm, move(len(arm)), row_times(2.0, 20), parameters=variations(SETS))
            seconds[name] = min(seconds[name], measured(task)[0][1])
    in_single_precision(figures, dry)
    for name, figure in (("six", "six_over_three"), ("water", "water_over_dry"), ("floating", "floating_over_fixed")):
        figures[figure] = seconds[name] / seconds["dry"]


def in_single_precision(figures: dict[str, float], arm: Arm) -> None:
    """How much faster, and how far from double precision after 10 s of the move."""
    runs = [
        partial(simulate_batch, arm, move(len(arm)), row_times(10.0, 20), parameters=variations(SETS), single=single)
        for single in (False, True)
    ]
    times = []
    for _ in range(4):
        (double, exact), (single, rounded) = (measured(run) for run in runs)
        times.append((double[1], single[1]))
    double_cpu, single_cpu = np.array(times).min(axis=0)
    figures["single_vs_double"] = double_cpu / single_cpu
    figures["differs_single"] = float(np.abs(exact.q - rounded.q).max())


def against(figures: dict[str, float], puma: Arm) -> None:
    """Three links, the same move, each peer over as long a stretch as it needs to be timed well."""
    arm, demand = first_joints(puma, 3), move(3)
    period = servo_period(arm)
    one, many = figures["three_links_one_x_real_time"], figures["three_links_1000_sets_x_real_time"]

    def demands(duration: float) -> Array:
        return references(arm, demand, 0, int(duration / period))

    def at_ticks(duration: float) -> Array:
        count = int(duration / period)
        return simulate_at(arm, demand, np.arange(count) * period).qm

    singles: dict[str, Callable[[Arm], Callable[[Array], Array]]] = {
        "pinocchio": peers.pinocchio,
        "mujoco": peers.mujoco_stepped,
        "numba_one": lambda arm: peers.numba_loops(arm, peers.printed(arm, {}, np.zeros(3)))[0],
    }
    for name, make in singles.items():
        try:
            run, given = make(arm), demands(1.0)
        except ImportError:
            continue
        seconds, shown = timed(lambda run=run, given=given: run(given))
        figures[f"{name}_x_real_time"] = len(given) * period / seconds
        figures[f"ours_one_vs_{name}"] = one / figures[f"{name}_x_real_time"]
        figures[f"differs_{name}"] = float(np.abs(shown - at_ticks(1.0)).max())
        if name != "numba_one":
            figures[f"ours_1000_sets_vs_{name}"] = many / figures[f"{name}_x_real_time"]
    batches: dict[str, Callable[[Arm, peers.Printed], Callable[[Array], Array]]] = {
        "numba_1000_sets": lambda arm, code: peers.numba_loops(arm, code)[1],
        "jax_1000_sets": peers.jax_batch,
    }
    sets, given = variations(SETS), demands(1.0)
    last = simulate_batch(arm, demand, np.array([(len(given) - 1) * period]), parameters=sets)
    for name, build in batches.items():
        try:
            begin = time.perf_counter()
            batch = build(arm, peers.printed(arm, sets, np.zeros(3)))
            batch(given[:2])
            figures[f"{name}_ready_s"] = time.perf_counter() - begin
        except ImportError:
            continue
        end = compared(figures, name, arm, lambda batch=batch: batch(given), SETS * len(given) * period)
        figures[f"differs_{name}"] = float(np.abs(end - last.qm[:, 0]).max())
    mujoco_rollout(figures, arm, period)


def compared(
    figures: dict[str, float], name: str, arm: Arm, batch: Callable[[], Array], simulated: float, rounds: int = 3
) -> Array:
    """Ours and a peer's batch in turns, the best of each; ``simulated`` s of all sets together in the peer's run."""
    task = partial(simulate_batch, arm, move(len(arm)), row_times(5.0, 20), parameters=variations(SETS))
    times = []
    for _ in range(rounds):
        own, (other, end) = measured(task)[0], measured(batch)
        times.append((*own, *other))
    own_wall, own_cpu, wall, cpu = np.array(times).min(axis=0)
    figures[f"{name}_x_real_time"] = simulated / wall
    figures[f"ours_1000_sets_vs_{name}"] = 5.0 * SETS / own_wall * wall / simulated
    figures[f"cpu_ours_1000_sets_vs_{name}"] = 5.0 * SETS / own_cpu * cpu / simulated
    return end


def measured(task: Callable[[], Result]) -> tuple[tuple[float, float], Result]:
    """((s of wall time, s of processor time of all threads), result)."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = task()
    return (time.perf_counter() - wall, time.process_time() - cpu), result


def mujoco_rollout(figures: dict[str, float], arm: Arm, period: float) -> None:
    try:
        import mujoco
        from mujoco import rollout
    except ImportError:
        return
    model = peers.mujoco_model(arm, period)
    data = [mujoco.MjData(model) for _ in range(cores())]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start, steps = np.zeros((SETS, size)), 200
    control = np.zeros((SETS, steps, len(arm)))
    task = partial(rollout.rollout, model, data, start, control)
    compared(figures, "mujoco_rollout_1000_sets", arm, task, SETS * steps * period)


_READY = """
import sys, time
import numpy as np
from arm_model.model_file import read_model
arm = read_model(sys.argv[1])
import llvmlite.binding
from arm_model.simulation import simulation
begin = time.perf_counter()
simulation.simulate(arm, lambda t: np.zeros((len(t), len(arm))), duration=0.001, rate=1000)
print(time.perf_counter() - begin)
"""


def ready(figures: dict[str, float]) -> None:
    """A new process, its modules imported: from the model to the first result, without and with kept machine code."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("ready_cold_s", "ready_cached_s"):
            command = [sys.executable, "-c", _READY, str(MODELS / "puma560.toml")]
            environment = {**os.environ, "ARMSCOPE_CACHE": folder, "PYTHONPATH": os.pathsep.join(sys.path)}
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            figures[name] = float(done.stdout)


def main() -> None:
    puma = read_model(MODELS / "puma560.toml")
    figures: dict[str, float] = {"cores": cores()}
    ours(figures, puma)
    at_the_limit(figures, puma)
    against(figures, puma)
    ready(figures)
    double_pendulum(figures)
    report(figures)


if __name__ == "__main__":
    main()
