"""Identification against published results, FIGAROH and plain least squares; and whether stated deviations are true.

python -m benchmarks.identification [--json] [--runs N]

EMPS and Panda need the measured data (``ARMSCOPE_SHARED``, else ../shared); FIGAROH 1.0.2 (PyPI) its own environment,
whose Python is named by ``FIGAROH_PYTHON``; ``mujoco.sysid`` the extra ``mujoco[sysid]``. What is not there is left out
of the figures, and named on standard error.

coverage_*   a simulated six-joint Puma (one excitation, its motion from the compiled closed loop), N times through
             encoders and the current chain with fresh noise and the rig's own clock: share of (run, identifiable base
             parameter) pairs within two stated deviations of the truth; the same by the textbook formula; the share of
             parameters for which at least 90 % of the runs are; bias (rms over parameters) and spread (median) over the
             stated deviation
coverage_1000hz_*  the same at 28 samples a setpoint, where servo ripple is folded onto the motion
fit_vs_PEER  time of one fit of that regressor (base parameters and their expressions' factors, joints weighted by their
             noise): FIGAROH's, and that of numpy's lstsq on all columns, which names nothing, over ours; more is better
solve_vs_plain_least_squares  the base parameters known (they are the arm's, not the run's): lstsq on all columns over
                              our weighted fit
*_held_out   relative error on another noise of another motion
emps_split_*  the first 70 % of the EMPS recording fitted, the rest held out, by us and by ``mujoco.sysid``
              (benchmarks/sysid_peer.py): the four
             parameters, the relative error of the force that they give to the held-out rows, and the whole time from
             samples to parameters
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.motion import Motion as Simulated
from arm_model.simulation.simulation import simulate_at
from benchmarks import sysid_peer
from benchmarks.report import report
from experiment import Experiment, demand_of
from identification.experiment_design import design_excitation
from identification.preprocessing import setpoints_of
from identification.preprocessing.setpoint_ripple import Driven, folded_torque
from identification.preprocessing.signals import Motion, smooth_motion, with_reversals
from identification.regression.base_parameters import base_parameters, structural_base
from identification.regression.equations import Equations, equations
from identification.regression.least_squares import joint_triangles, least_squares, relative_error
from identification.regression.model_parameters import model_values
from identification.regression.uncertainty import fit_uncertainty

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("ARMSCOPE_SHARED", ROOT.parent / "shared"))
TURNS = np.array([10, 10, 10, 20, 20, 20])  # through the Hall transducers' cores
RATE = 28.382 / 0.028  # Hz: no simple ratio to the setpoints' 28 ms
IN_STEP = 28 / 0.028  # Hz: ripple above half the rate is folded onto the motion's own band
LSB = 20 / 4096  # V, twelve bits over +-10 V

FIGAROH = """
import sys, time, warnings
import numpy as np
warnings.simplefilter("ignore")
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import get_index_eliminate, build_regressor_reduced
data = np.load(sys.argv[1])
W, tau, names = data["W"], data["tau"], [str(n) for n in data["names"]]
best = np.inf
for _ in range(50):
    start = time.perf_counter()
    idx, kept = get_index_eliminate(W, dict.fromkeys(names, 0.0), 1e-6)
    reduced = build_regressor_reduced(W, idx)
    decomposer = QRDecomposer()
    phi = decomposer.double_decomposition(tau, reduced, kept)[3]
    best = min(best, time.perf_counter() - start)
order = [names.index(kept[k]) for k in decomposer.base_indices]
residual = data["tau_held"] - data["W_held"][:, order] @ phi
print(best, len(order), np.linalg.norm(residual) / np.linalg.norm(data["tau_held"]))
"""


def measured(name: str) -> tuple[Array, Array, Array]:
    """t (n,), q (n, J), i (n, J) of a published recording."""
    data = np.genfromtxt(SHARED / "data" / name, delimiter=",", names=True)
    joints = sum(column[0] == "q" and column[1:].isdigit() for column in data.dtype.names)
    stack = [np.stack([data[f"{kind}{j + 1}"] for j in range(joints)], axis=1) for kind in "qi"]
    return data["t"], stack[0], stack[1]


def published() -> dict[str, float]:
    """Relative errors (and EMPS parameters) on the published recordings."""
    figures: dict[str, float] = {}
    for label, model, name in (("emps", "emps", "emps/train.csv"), ("panda", "panda", "panda/trajectory_1.csv")):
        if not (SHARED / "data" / name).exists():
            continue
        arm = read_model(ROOT / f"config/models/{model}.toml")
        t, q, i = measured(name)
        motion = smooth_motion(t, q, i * np.array([joint.drive_constant for joint in arm.joints]))
        for friction in ("symmetric", "asymmetric"):
            rows, base = equations(arm, [motion], friction), structural_base(arm, friction)
            fit = least_squares(rows.columns[:, base.kept], rows.torque, rows.joint, "ols")
            whole = equations(arm, [with_reversals(motion)], friction)
            residual = whole.torque - whole.columns[:, base.kept] @ fit.values
            figures[f"{label}_{friction}_relative_error"] = relative_error(whole.torque, residual)
            if label == "emps" and friction == "symmetric":
                figures |= {f"emps_{base.expression(k)}": float(fit.values[k]) for k in range(len(base))}
    return figures


def split_drive() -> dict[str, float]:
    """Parameters, held-out error and time on one half-known drive: ours and ``mujoco.sysid``'s."""
    if not (SHARED / "data/emps/train.csv").exists():
        return {}
    arm = read_model(ROOT / "config/models/emps.toml")
    data = np.genfromtxt(SHARED / "data/emps/train.csv", delimiter=",", names=True)
    t, q, demand = (data[name] for name in ("t", "q1", "qref1"))
    force = data["i1"] * arm.joints[0].drive_constant
    early = t < t[0] + 0.7 * (t[-1] - t[0])

    def rows_of(part: Array, *, judged: bool = False) -> Equations:
        motion = smooth_motion(t[part], q[part, None], force[part, None])
        return equations(arm, [with_reversals(motion) if judged else motion])

    def ours() -> Array:
        rows = rows_of(early)
        return least_squares(rows.columns[:, order], rows.torque, rows.joint, "ols").values

    late = rows_of(~early, judged=True)
    order = [late.names.index(name) for name in sysid_peer.NAMES]
    figures: dict[str, float] = {}
    found = {"ours": (ours(), best_of(ours)[0])}
    if sysid_peer.installed():
        values, half, seconds = sysid_peer.fit_drive(arm, t[early], q[early], force[early], demand[early])
        found["mujoco_sysid"] = (np.array([values[name] for name in sysid_peer.NAMES]), seconds)
        figures["emps_split_mujoco_sysid_link1.mass_interval"] = half["link1.mass"]
    else:
        absent("mujoco.sysid: pip install 'mujoco[sysid]>=4'")
    for who, (parameters, seconds) in found.items():
        residual = late.torque - late.columns[:, order] @ parameters
        figures |= {f"emps_split_{who}_{name}": float(v) for name, v in zip(sysid_peer.NAMES, parameters)}
        figures[f"emps_split_{who}_held_out"] = relative_error(late.torque, residual)
        figures[f"emps_split_{who}_seconds"] = seconds
    if "mujoco_sysid" in found:
        figures["emps_split_vs_mujoco_sysid"] = found["mujoco_sysid"][1] / found["ours"][1]
    return figures


def absent(what: str) -> None:
    """Says on standard error which peer is not measured, and how it would be."""
    print(f"not measured: {what}", file=sys.stderr)


def sampled(arm: Arm, experiment: Experiment, seed: int, rate: float) -> Simulated:
    """The closed loop at the instants of a rig's own clock: any phase to the servos', its quartz off by some 50 ppm."""
    random = np.random.default_rng([seed, 1])
    demand = demand_of(experiment)
    period = (1 + 50e-6 * random.standard_normal()) / rate
    times = period * (np.arange(int(demand.duration / period) - 1) + random.uniform())
    return simulate_at(arm, demand, times)


def recorded(arm: Arm, run: Simulated, seed: int) -> Motion:
    """What a rig records of a simulated run.

    Encoder counts from a random start, current by turns, transducer and twelve bits.
    """
    random = np.random.default_rng(seed)
    counts = np.array([4 * (joint.encoder_lines or 250) * joint.ratio / (2 * np.pi) for joint in arm.joints])
    q = np.floor(run.qm * counts + random.uniform(0, 1, len(arm))) / counts
    volts = run.current * TURNS / 20 + 4e-3 * random.standard_normal(run.current.shape)
    current = np.clip(np.rint(volts / LSB) * LSB, -10, 10 - LSB) * 20 / TURNS
    torque = current * np.array([joint.drive_constant for joint in arm.joints])
    motion = smooth_motion(run.t, q, torque)
    setpoints = setpoints_of(arm, motion.dt)
    return replace(motion, folded=folded_torque(motion, Driven(run.t, torque, setpoints)))


def puma() -> tuple[Arm, list[Experiment]]:
    """The nominal Puma and two excitations, one to fit and one held out."""
    arm = read_model(ROOT / "config/models/puma560.toml")
    return arm, [design_excitation(arm, candidates=640, seed=seed) for seed in (1, 2)]


def coverage(arm: Arm, experiment: Experiment, count: int, *, rate: float = RATE, first: int = 0) -> dict[str, float]:
    """How often two stated deviations hold the truth; seeds ``first`` ..."""
    # The class that the truth is in: its Coulomb friction differs by direction.
    base = structural_base(arm, "asymmetric")
    truth = base.grouping @ model_values(arm, "asymmetric")
    inside, formula, known, off_by = [], [], [], []
    for seed in range(first, first + count):
        rows = equations(arm, [recorded(arm, sampled(arm, experiment, seed, rate), seed)], "asymmetric")
        columns = rows.columns[:, base.kept]
        fit = least_squares(columns, rows.torque, rows.joint, "wls")
        uncertainty = fit_uncertainty(columns, rows, fit)
        off = np.abs(fit.values - truth)
        off_by.append((fit.values - truth) / uncertainty.std)
        inside.append(off < 2 * uncertainty.std)
        formula.append(off < 2 * uncertainty.std_formula)
        felt = np.array(
            [
                s * np.sqrt(np.mean(c[c != 0] ** 2)) / np.sqrt(np.mean(rows.torque[c != 0] ** 2))
                for s, c in zip(uncertainty.std, columns.T)
            ]
        )
        known.append((uncertainty.std < 0.3 * np.abs(fit.values)) | (felt < 0.02))
        if sys.stderr.isatty():
            print(f"\rrun {seed + 1} of {count}", end="", file=sys.stderr)
    identifiable = np.mean(known, axis=0) > 0.5
    each = np.mean(inside, axis=0)[identifiable]
    spread_of = np.array(off_by)[:, identifiable]
    return {
        "coverage_runs": count,
        "coverage_bias_over_deviation": float(np.sqrt(np.mean(spread_of.mean(axis=0) ** 2))),
        "coverage_spread_over_deviation": float(np.median(spread_of.std(axis=0))),
        "coverage_parameters": int(identifiable.sum()),
        "coverage_two_deviations": float(each.mean()),
        "coverage_two_deviations_formula": float(np.mean(formula, axis=0)[identifiable].mean()),
        "coverage_share_of_parameters_at_90_percent": float(np.mean(each >= 0.9)),
        "coverage_worst_parameter": float(each.min()),
    }


def peers(arm: Arm, experiments: list[Experiment]) -> dict[str, float]:
    """Time and held-out error of one regressor, here and there."""
    rows, held = (
        equations(arm, [recorded(arm, sampled(arm, experiment, 1000 + k, RATE), 1000 + k)])
        for k, experiment in enumerate(experiments)
    )
    base = structural_base(arm)
    figures = {"fit_rows": float(len(rows)), "fit_columns": float(len(rows.names))}

    def ours() -> Array:
        parts = joint_triangles(rows.columns, rows.torque, rows.joint)
        kept = base_parameters(parts.columns, rows.names).kept
        return least_squares(rows.columns[:, kept], rows.torque, rows.joint, "wls").values

    known = rows.columns[:, base.kept]
    figures["fit_seconds"], figures["plain_least_squares_seconds"], figures["solve_seconds"] = best_of(
        ours,
        lambda: np.linalg.lstsq(rows.columns, rows.torque, rcond=None)[0],
        lambda: least_squares(known, rows.torque, rows.joint),
    )
    values = least_squares(rows.columns[:, base.kept], rows.torque, rows.joint, "wls").values
    figures["ours_held_out"] = relative_error(held.torque, held.torque - held.columns[:, base.kept] @ values)
    figures["plain_least_squares_held_out"] = plain(rows, held)
    figures["fit_vs_plain_least_squares"] = figures["plain_least_squares_seconds"] / figures["fit_seconds"]
    figures["solve_vs_plain_least_squares"] = figures["plain_least_squares_seconds"] / figures["solve_seconds"]
    if python := os.environ.get("FIGAROH_PYTHON"):
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "rows.npz"
            np.savez(
                place,
                W=rows.columns,
                tau=rows.torque,
                names=np.array(rows.names),
                W_held=held.columns,
                tau_held=held.torque,
            )
            done = subprocess.run([python, "-c", FIGAROH, str(place)], capture_output=True, text=True, check=False)
        if done.returncode:
            warnings.warn(f"FIGAROH: {done.stderr.strip().splitlines()[-1]}", stacklevel=1)
        else:
            seconds, rank, error = map(float, done.stdout.split()[-3:])
            figures |= {"figaroh_seconds": seconds, "figaroh_base_parameters": rank, "figaroh_held_out": error}
            figures["fit_vs_figaroh"] = seconds / figures["fit_seconds"]
    else:
        absent("FIGAROH: FIGAROH_PYTHON names no Python that has it")
    return figures


def plain(rows: Equations, held: Equations) -> float:
    """Held-out error of numpy's least squares on all standard columns."""
    values = np.linalg.lstsq(rows.columns, rows.torque, rcond=None)[0]
    return relative_error(held.torque, held.torque - held.columns @ values)


def best_of(*works: Callable[[], object], times: int = 50) -> list[float]:
    """s of the quickest of some calls of each, in turn: what else the machine does falls on all of them."""
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(times):
        for work, mine in zip(works, taken):
            start = time.perf_counter()
            work()
            mine.append(time.perf_counter() - start)
    return [min(mine) for mine in taken]


def main() -> None:
    count = int(sys.argv[sys.argv.index("--runs") + 1]) if "--runs" in sys.argv else 100
    arm, experiments = puma()
    covered = coverage(arm, experiments[0], count)
    in_step = coverage(arm, experiments[0], count, rate=IN_STEP)
    in_step = {name.replace("coverage_", "coverage_1000hz_"): value for name, value in in_step.items()}
    report(published() | split_drive() | peers(arm, experiments) | covered | in_step)


if __name__ == "__main__":
    main()
