"""A three-joint arm with friction as arms have it, simulated by MuJoCo: nothing of it is an effect of the catalogue.

A vertical axis and two horizontal ones, gears of 80 to 100, PID servos, encoders of 2^17 counts per joint revolution,
currents with noise, logged at 500 Hz. Friction is a function of speed that a test chooses, and ``more`` Coulomb
friction of one joint (from 1) on the second day.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from arm_model import Arm, Controller, Joint, write_model
from armscope.cli import run

Law = Callable[[np.ndarray], np.ndarray]
"""(3,) N m against motion at speeds (3,) rad/s of the joints."""

STEP, EVERY = 1e-3, 2
COUNTS = 2**17
GEAR, CONSTANT = np.array([100.0, 100.0, 80.0]), np.array([0.11, 0.11, 0.09])
NOISE = np.array([0.012, 0.012, 0.012])
GAINS = np.array([[9000.0, 9000.0, 3000.0], [900.0, 900.0, 300.0], [4000.0, 4000.0, 1500.0]])
"""N m/rad, N m s/rad, N m/(rad s)."""
ROTOR = np.array([1.6, 1.6, 0.7])
LINKS = ((7.0, (0.0, 0.0, -0.04), (0.05, 0.05, 0.03)), (9.0, (0.22, 0.0, 0.0), (0.03, 0.35, 0.35)))
FORE = (4.0, (0.15, 0.01, 0.0), (0.01, 0.08, 0.08))

WAVES = np.array([7.0, 11.0, 13.0])
"""Per turn of a joint: of a ripple of friction, as of rollers on an uneven race."""

HARD = 'solreffriction="0.002 1" solimpfriction="0.999 0.9999 0.001"'
"""MuJoCo yields a little where friction holds, and more than a hump is high if left as it is."""

SCENE = """<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"/><worldbody>
<body name="b1" pos="0 0 0.4"><joint axis="0 0 1" frictionloss="1" {hard} armature="{r[0]}"/>{i[0]}
<body name="b2" euler="-90 0 0"><joint axis="0 0 1" frictionloss="1" {hard} armature="{r[1]}"/>{i[1]}
<body name="b3" pos="0.45 0 0"><joint axis="0 0 1" frictionloss="1" {hard} armature="{r[2]}"/>{i[2]}
</body></body></body></worldbody></mujoco>"""


def model() -> Arm:
    """What a stranger brings: geometry and drives right, masses rounded, friction unknown."""
    places = (
        {"xyz": (0.0, 0.0, 0.4)},
        {"rpy": (-np.pi / 2, 0.0, 0.0)},
        {"xyz": (0.45, 0.0, 0.0)},
    )
    joints = tuple(
        Joint(
            convention="placed",
            axis=(0.0, 0.0, 1.0),
            **place,
            mass=1.15 * mass,
            com=com,
            inertia=(*inertia, 0.0, 0.0, 0.0),
            gear=float(GEAR[j]),
            torque_constant=float(CONSTANT[j]),
            rotor_inertia=1e-4,
            coulomb=(0.02, 0.02),
            viscous=(1e-3, 1e-3),
            sign_velocity=0.002,
        )
        for j, (place, (mass, com, inertia)) in enumerate(zip(places, (*LINKS, FORE)))
    )
    drive = GEAR * CONSTANT
    gains = [tuple(float(v) for v in row / drive) for row in GAINS]
    servo = Controller(
        kind="gains",
        setpoint_period=0.002,
        servo_period=0.002,
        position_gain=gains[0],
        velocity_gain=gains[1],
        integral_gain=gains[2],
    )
    return Arm("rubbing arm", joints, gravity=(0.0, 0.0, -9.81), controller=servo)


def demand(seed: int, t: np.ndarray) -> np.ndarray:
    """(m, 3) rad: slow and fast sines of each joint, smoothly begun."""
    rng = np.random.default_rng(seed)
    begun = np.clip((t - 1.0) / 2.0, 0.0, 1.0)
    begun = begun * begun * (3 - 2 * begun)
    found = []
    for size in (0.9, 0.6, 0.9):
        frequency = np.array([0.045, 0.11, 0.23, 0.41]) * rng.uniform(0.85, 1.15, 4)
        amplitude = size * np.array([0.45, 0.3, 0.16, 0.08]) * rng.uniform(0.8, 1.2, 4)
        phase = rng.uniform(0, 2 * np.pi, 4)
        found.append(begun * (np.sin(2 * np.pi * np.outer(t, frequency) + phase) @ amplitude))
    return np.stack(found, axis=1) + [0.0, -0.5, 0.6]


def recording(
    path: Path,
    law: Law,
    seed: int,
    *,
    seconds: float = 40.0,
    more: dict[int, float] | None = None,
    added: Law = np.zeros_like,
    ripple: float = 0.0,
) -> Path:
    """Writes a recording of the motion ``seed`` through a table of t, q, i, qref, as a controller logs them.

    ``more``: {joint from 1: N m} additional friction, constant against the motion. ``added``: (3,) N m more against
    the motion, of the speeds with their signs. ``ripple``: share of all friction that waves with the joints' angles.
    """
    bodies = [
        f'<inertial mass="{m}" pos="{c[0]} {c[1]} {c[2]}" diaginertia="{i[0]} {i[1]} {i[2]}"/>'
        for m, c, i in LINKS + (FORE,)
    ]
    machine = mujoco.MjModel.from_xml_string(SCENE.format(step=STEP, hard=HARD, r=ROTOR, i=bodies))
    state = mujoco.MjData(machine)
    extra = np.zeros(3)
    for joint, torque in (more or {}).items():
        extra[joint - 1] = torque
    count = int(seconds / STEP / EVERY)
    t = np.arange(count) * STEP * EVERY
    wanted = demand(seed, t)
    rates = np.gradient(wanted, t, axis=0)
    rng = np.random.default_rng(seed + 77)
    state.qpos[:] = wanted[0]
    mujoco.mj_forward(machine, state)
    integral = np.array(state.qfrc_bias)
    q, i = np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        error = wanted[k] - state.qpos
        integral += GAINS[2] * error * STEP * EVERY
        torque = GAINS[0] * error + GAINS[1] * (rates[k] - state.qvel) + integral
        q[k], i[k] = state.qpos, torque
        for _ in range(EVERY):
            rubbing = law(np.abs(state.qvel)) + extra + added(state.qvel)
            machine.dof_frictionloss[:] = rubbing * (1.0 + ripple * np.sin(WAVES * state.qpos))
            state.qfrc_applied[:] = torque
            mujoco.mj_step(machine, state)
    step = 2 * np.pi / COUNTS
    table = np.column_stack(
        [t, np.round(q / step) * step, i / (GEAR * CONSTANT) + NOISE * rng.normal(size=i.shape), wanted]
    )
    names = [f"{kind}{j}" for kind in ("q", "i", "qref") for j in (1, 2, 3)]
    log = path.with_suffix(".csv")
    np.savetxt(log, table, delimiter=",", header=",".join(["t", *names]), comments="", fmt="%.9g")
    assert run(["import", str(log), "--out", str(path)]) == 0
    return path


def stranger(path: Path) -> Path:
    """Writes the model file."""
    write_model(path, model())
    return path


def sigmoid(v: np.ndarray) -> np.ndarray:
    """The published sigmoid of the Panda (Gaz et al., RA-L 2019) at joints 1, 2, 4, thrice as large, and viscous."""
    size, slope = np.array([0.54615, 0.87224, 1.2794]), np.array([5.1181, 9.0657, 5.5903])
    shift = np.array([0.039533, 0.025882, 0.036194])
    rise = 1 / (1 + np.exp(-slope * (v + shift))) - 1 / (1 + np.exp(-slope * shift))
    return 10.0 * size * rise + 0.5 * v


def humped(v: np.ndarray) -> np.ndarray:
    """A constant, a Stribeck hump and |v|^0.6."""
    constant, hump, power = np.array([9.0, 10.0, 5.0]), np.array([2.5, 3.0, 1.5]), np.array([9.0, 11.0, 6.0])
    return constant + hump * np.exp(-((v / 0.05) ** 2)) + power * v**0.6
