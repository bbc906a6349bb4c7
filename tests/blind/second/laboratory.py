"""Whose arm it is: drives, friction, servos, rates, instruments and their noise, drawn as laboratories differ.

What a laboratory knows of its arm stands in its model file: sizes, friction, encoders and, where the file has words
for their structure, the servos.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.tables.controller import Controller
from arm_model.tables.link_shapes import Cylinder
from tests.blind.second.plant import Plant, Servo
from tests.blind.second.rigid_body import mass_matrix, torques
from tests.blind.second.stability import tuned

NOMINAL = Path(__file__).resolve().parents[3] / "config" / "models" / "puma560.toml"
POSE = np.array([0.0, 0.5, -1.0, 0.0, 0.5, 0.0])
"""rad: where the gains of the servos are worked out."""
POSES = np.array([POSE, *([0.0, q2, q3, 0.0, 0.5, 0.0] for q2 in (-1.0, 0.6, 2.2) for q3 in (-1.7, -0.4, 0.9))])
"""(k, 6) rad: where they must be stable; the links of joints 2 and 3 stretched out and folded."""
STIFF = np.array([8e5, 1e6, 4e5, 1e4, 1e4, 3e3])
"""N m/rad of healthy gears: with 120 Hz and more, their resonances are beyond what moves."""
DAMPING = 0.1 * np.sqrt(STIFF * np.array([0.6, 1.5, 0.4, 0.002, 4e-4, 4e-5]))
"""N m s/rad."""
INTERPOLATED = 2000
"""Steps per count that the servos make of the encoders' sines; the counters of the rig do not.

With steps of a fiftieth the differenced angle would shake the currents by several times their noise.
"""
SERVOS = ("bandwidth", "pid", "cascade", "cascade without feed-forward", "gravity feed-forward")
KNOWN = SERVOS[:3]
"""Structures that a model file can say."""


@dataclass(frozen=True)
class Laboratory:
    """What two laboratories with the same arm would not have in common.

    rate           Hz of the rows
    servo          one of ``SERVOS``, with setpoints every ``setpoint_period`` s and ticks every ``servo_period`` s
    lines          of the encoders over the nominal ones
    white, colour  A rms at joints 1 to 3 (the wrist: half), independent and correlated over ``correlation`` s
    ripple         A, of the drives' switching, which sampling puts at any frequency and which wanders
    bits           of the converter, -10 to 10 V for -20 to 20 A
    bandwidth      Hz of the transducers
    rest_velocity  rad/s over which dry friction turns round
    link_encoders  counts per turn of encoders at the links; 0: there are none
    tracker, water  whether there are
    """

    seed: int
    motions: str
    rate: float
    servo: str
    setpoint_period: float
    servo_period: float
    lines: int
    white: float
    colour: float
    correlation: float
    ripple: float
    bits: int
    bandwidth: float
    rest_velocity: float
    link_encoders: int
    tracker: bool
    water: bool

    @property
    def sees_links(self) -> bool:
        """Whether an instrument shows where the links are; then the model has the springs of the gears."""
        return self.tracker or self.link_encoders > 0

    @property
    def noise(self) -> Array:
        """(6,) A rms of what the instruments add to a current."""
        step = 40.0 / 2**self.bits
        independent = np.hypot(self.white, self.colour) * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
        return np.sqrt(independent**2 + step**2 / 12.0 + self.ripple**2 / 2.0)


def laboratory(seed: int, *, tracker: bool = False, water: bool = False) -> Laboratory:
    """One of them; with a tracker or under water where that is asked for."""
    rng = np.random.default_rng([seed, 991])
    white = float(np.exp(rng.uniform(np.log(0.004), np.log(0.012))))
    period, servo = [(0.028, 0.000875), (0.01, 0.001), (0.004, 0.0005), (0.02, 0.001), (0.008, 0.001)][rng.integers(5)]
    return Laboratory(
        seed=seed,
        motions=str(rng.choice(["moves", "singles", "waves"])),
        rate=float(rng.choice([250.0, 500.0, 1000.0, 2000.0])),
        servo=str(rng.choice(SERVOS, p=[0.25, 0.2, 0.25, 0.15, 0.15])),
        setpoint_period=period,
        servo_period=servo,
        lines=int(rng.choice([1, 2, 4])),
        white=white,
        colour=white * float(rng.choice([0.0, 0.5, 1.0])),
        correlation=float(rng.uniform(0.02, 0.15)),
        ripple=white * float(rng.choice([0.0, 0.5])),
        bits=int(rng.choice([12, 14, 16])),
        bandwidth=float(rng.choice([2e3, 5e3, 2e4])),
        rest_velocity=float(rng.uniform(0.003, 0.006)),
        link_encoders=int(rng.choice([0, 0, 0, 2**18, 2**20])),
        tracker=tracker or bool(rng.uniform() < 0.2),
        water=water,
    )


@cache
def arm_of(where: Laboratory) -> Arm:
    """The arm as its laboratory knows it."""
    rng = np.random.default_rng([where.seed, 992])
    joints = []
    for number, joint in enumerate(read_model(NOMINAL).joints):
        rub, oil = rng.uniform(0.7, 1.4, 2)
        change: dict[str, object] = {
            "coulomb": tuple(rub * value for value in joint.coulomb),
            "viscous": tuple(oil * value for value in joint.viscous),
            "encoder_lines": where.lines * joint.encoder_lines,
        }
        if where.water and number in (1, 2):
            end = (-0.4, 0.0, 0.1) if number == 1 else (0.0, -0.05, 0.3)
            change["cylinder"] = Cylinder(
                (0.0, 0.0, 0.1) if number == 1 else (0.0, 0.0, 0.0), end, 0.06, 1025.0, 1.0, 1.0, 1.0
            )
        joints.append(replace(joint, **change))  # type: ignore[arg-type]
    arm = replace(read_model(NOMINAL), joints=tuple(joints), controller=None)
    if where.sees_links:
        # healthy gears give way by less than currents show, and by more than link encoders and trackers do
        springs = [{"stiffness": float(k), "damping": float(c)} for k, c in zip(STIFF, DAMPING)]
        arm = replace(arm, effects=tuple(EffectTerm("joint_compliance", j, v) for j, v in enumerate(springs, 1)))
    if where.servo not in KNOWN:
        return arm
    servo = servo_of(where, plant_of(where, arm))
    if where.servo == "cascade":
        # int (r' - v) is r - q, and the arm begins at rest: a P-PI cascade is a PID in the error
        return replace(arm, controller=_controller(where, servo, servo.position + servo.velocity_integral))
    return replace(arm, controller=_controller(where, servo, servo.position))


def _controller(where: Laboratory, servo: Servo, position: Array) -> Controller:
    return Controller(
        setpoint_period=where.setpoint_period,
        servo_period=where.servo_period,
        kind="gains",
        position_gain=tuple(map(float, position)),
        integral_gain=tuple(map(float, servo.integral)),
        velocity_gain=tuple(map(float, servo.velocity)),
        velocity_bandwidth=servo.bandwidth,
        current_lag=servo.lag,
    )


def plant_of(where: Laboratory, arm: Arm) -> Plant:
    """The healthy arm."""
    n = len(arm.joints)
    column = lambda name: np.array([getattr(joint, name) for joint in arm.joints], float)  # noqa: E731
    gear = np.abs(column("gear"))
    drive = gear * column("torque_constant")
    cylinders = np.zeros((n, 10))
    for k, joint in enumerate(arm.joints):
        if (c := joint.cylinder) is not None:
            shape = (*c.start, *c.end, c.radius, c.drag_coefficient, c.added_mass_coefficient, c.buoyancy)
            cylinders[k] = shape
    none, many = np.zeros(n), lambda *size: np.zeros((n, *size))
    rotor = column("rotor_inertia") * gear**2
    return Plant(
        dh=np.array([[joint.theta, joint.d, joint.a, joint.alpha] for joint in arm.joints]),
        bodies=np.array([[joint.mass, *joint.com] for joint in arm.joints]),
        inertia=column("inertia"),
        cylinders=cylinders,
        gravity=np.array(arm.gravity),
        gear=gear,
        rotor=rotor,
        drive=drive,
        limit=column("torque_limit") / drive,
        viscous=column("viscous") * gear[:, None] ** 2,
        coulomb=column("coulomb") * gear[:, None],
        rest=np.full(n, where.rest_velocity),
        more_viscous=none.copy(),
        more_coulomb=none.copy(),
        load_share=none.copy(),
        growth=0.0,
        breakaway=none.copy(),
        stribeck=np.full(n, 0.05),
        bristle=none.copy(),
        bristle_damping=none.copy(),
        fading=none.copy(),
        fading_time=np.ones(n),
        stiffness=STIFF.copy(),
        damping=DAMPING.copy(),
        half_gap=none.copy(),
        spring=many(3),
        drag=none.copy(),
        cog=many(3),
        tooth=many(3),
        coupling=np.eye(n),
        wave=many(4),
        count=2 * np.pi / (4 * column("encoder_lines") * gear * INTERPOLATED),
        missed=np.tile([0.0, np.inf], (n, 1)),
        zero=none.copy(),
        core=many(2),
        hunting=many(2),
    )


def servo_of(where: Laboratory, healthy: Plant) -> Servo:
    """The servos, tuned to the healthy arm; stable on its joints of two masses in every pose, with a gain margin."""
    rng = np.random.default_rng([where.seed, 993])
    mass = np.empty((6, 6))
    mass_matrix(healthy.dh, healthy.bodies, healthy.inertia, healthy.cylinders, POSE, mass)
    inertia = (np.diag(mass) + healthy.rotor) / healthy.drive
    pulsation = rng.uniform(0.7, 1.2) * np.array([40.0, 40.0, 45.0, 60.0, 60.0, 60.0])
    damping, zero = float(rng.uniform(0.8, 1.2)), np.zeros(6)
    lag, bandwidth = float(rng.choice([0.0004, 0.0008])), float(rng.choice([300.0, 500.0, 800.0]))
    position, velocity = pulsation**2 * inertia, 2 * damping * pulsation * inertia
    if where.servo.startswith("cascade"):
        outer = 0.5 * pulsation
        forward = 1.0 if where.servo == "cascade" else 0.0
        inner = 4.0 * velocity
        servo = Servo(where.servo_period, lag, outer * velocity, outer * inner, velocity, inner, forward, bandwidth)
        return tuned(healthy, servo, POSES)
    integral = zero if where.servo == "gravity feed-forward" else float(rng.uniform(1.0, 3.0)) * position
    servo = Servo(where.servo_period, lag, position, integral, velocity, zero, 1.0, bandwidth)
    return tuned(healthy, servo, POSES)


def feed_forward(where: Laboratory, healthy: Plant, demand: Array) -> Array:
    """(ticks, n) A that hold the healthy arm against gravity at its demands, where the servos have that."""
    extra = np.zeros_like(demand)
    if where.servo == "gravity feed-forward":
        for row, q in enumerate(demand):
            extra[row] = holding(healthy, q) / healthy.drive
    return extra


def holding(plant: Plant, q: Array) -> Array:
    """(n,) N m that hold the links against gravity, springs aside."""
    still = np.zeros(len(q))
    return torques(plant.dh, plant.bodies, plant.inertia, plant.cylinders, plant.gravity, q, still, still)


def own_springs(where: Laboratory, softened: Collection[int | None]) -> list[dict[str, object]]:
    """The springs of healthy gears that the plant has and its model lacks, in the form of what is hidden.

    softened: joints (from 1) whose spring is hidden itself. Dampings are no figures of the gears' makers: not told.
    """
    if where.sees_links:
        return []
    every = enumerate(STIFF.tolist(), 1)
    return [
        {"effect": "joint_compliance", "joint": joint, "parameters": {"stiffness": stiffness}}
        for joint, stiffness in every
        if joint not in softened
    ]


def as_table(where: Laboratory) -> dict[str, object]:
    """For JSON."""
    return asdict(where)
