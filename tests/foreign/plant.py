"""An arm in MuJoCo: its rigid bodies, drives, friction, springs and stops, under a servo of its own.

Nothing here is armscope's. Every drive is a fixed tendon of MuJoCo, with the rotor as its armature: of a coupled arm it
moves several joints. Friction is MuJoCo's own constraint (stiction included), whose level this module sets at every
step by the law of the drive; what MuJoCo has no law for is a torque from outside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from tests.foreign.arms import ForeignArm
from tests.foreign.urdf import urdf

STEP = 0.001
"""s: of MuJoCo and of the servo."""
GRAVITY = 9.80665
SETTLE = 0.5
"""s at the first setpoint before a recording begins."""
Array = np.ndarray


@dataclass(frozen=True)
class Friction:
    """Friction of n drives, opposing the motion at speed v, each (n,).

    (level + hump exp(-(v / stribeck)^2) + power |v|^0.6 + by_load |transmitted|) (1 + asymmetry sign v)
    times 1 - fading (1 - exp(-t / fading_time)), plus viscous v, plus the sigmoid of Gaz et al. (2019):
    sigmoid (1 / (1 + exp(-steep (v + shift))) - 1 / (1 + exp(-steep shift))).
    """

    level: Array
    viscous: Array
    hump: Array
    stribeck: Array
    power: Array
    sigmoid: Array
    steep: Array
    shift: Array
    asymmetry: Array
    by_load: Array
    fading: Array
    fading_time: Array

    def most(self, t: float, v: Array, transmitted: Array) -> Array:
        """(n,) the level of dry friction at a moment."""
        speed = np.abs(v)
        level = self.level + self.hump * np.exp(-((v / self.stribeck) ** 2)) + self.power * speed**0.6
        level = (level + self.by_load * np.abs(transmitted)) * (1.0 + self.asymmetry * np.sign(v))
        return level * (1.0 - self.fading * (1.0 - np.exp(-t / self.fading_time)))

    def smooth(self, v: Array) -> Array:
        """(n,) torque of the sigmoid, with the sign of a torque on the drive."""
        at_rest = 1.0 / (1.0 + np.exp(-self.steep * self.shift))
        return -self.sigmoid * (1.0 / (1.0 + np.exp(-self.steep * (v + self.shift))) - at_rest)


@dataclass(frozen=True)
class Plant:
    """An arm as it is; per drive (n,) unless said otherwise.

    strength      applied torque over the torque that the controller believes to apply
    limit         of the controller's torque
    spring, rest  a spring about an angle; ripple, cycles, phase: torque over the drive's angle
    zero          the reported angle is larger by this than the angle of the link
    springy       drive (from 1) whose gear deflects, by ``stiffness`` and ``damping`` in series with a gap of +-``gap``
    payload       mass kg, com (3,) m and principal inertia (3,) kg m2 about it, fixed to the last link
    extra         (link from 1, mass, com (3,)) of a piece that is fixed to another link
    tilt          (2,) rad: roll and pitch of the base
    """

    arm: ForeignArm
    friction: Friction
    rotor: Array
    strength: Array
    limit: Array
    spring: Array
    rest: Array
    ripple: Array
    cycles: Array
    phase: Array
    zero: Array
    tilt: Array
    springy: int | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    gap: float = 0.0
    payload: tuple[float, Array, Array] | None = None
    extra: tuple[int, float, Array] | None = None

    def changed(self, name: str, drive: int, by: float) -> Plant:
        """With one value of one drive (from 1) larger by this; a name of ``Friction`` counts as well."""
        if hasattr(self.friction, name):
            return replace(
                self, friction=replace(self.friction, **{name: _added(getattr(self.friction, name), drive, by)})
            )
        return replace(self, **{name: _added(getattr(self, name), drive, by)})


def _added(values: Array, drive: int, by: float) -> Array:
    values = values.copy()
    values[drive - 1] += by
    return values


def healthy(arm: ForeignArm) -> Plant:
    """The arm with Coulomb and viscous friction, as its data sheet has it."""
    column = lambda name: np.array([getattr(joint, name) for joint in arm.joints], float)  # noqa: E731
    zero, one = np.zeros(len(arm.joints)), np.ones(len(arm.joints))
    friction = Friction(
        level=column("coulomb"),
        viscous=column("viscous"),
        hump=zero,
        stribeck=one,
        power=zero,
        sigmoid=zero,
        steep=one,
        shift=zero,
        asymmetry=zero,
        by_load=zero,
        fading=zero,
        fading_time=one,
    )
    return Plant(
        arm=arm,
        friction=friction,
        rotor=column("rotor"),
        strength=one,
        limit=2 * column("rated"),
        spring=zero,
        rest=zero,
        ripple=zero,
        cycles=one,
        phase=zero,
        zero=zero,
        tilt=np.zeros(2),
    )


@dataclass(frozen=True)
class Run:
    """What happened: t (m,) s every ``STEP``; angle, torque (m, n) as encoders and controller have them, unspoilt."""

    t: Array
    angle: Array
    torque: Array


def run(plant: Plant, target: Array, bandwidth: float) -> Run:
    """The arm follows targets (m, n), one per ``STEP``, with servos of this bandwidth, rad/s."""
    model, drives, zero = compiled(plant)
    data = mujoco.MjData(model)
    data.qpos[:] = np.linalg.pinv(drives) @ (target[0] - zero)
    mass = _inertia(model, data, drives) + plant.rotor
    position, speed, integral = bandwidth**2 * mass, 1.6 * bandwidth * mass, bandwidth**2 * mass * bandwidth / 8
    count, settling = len(plant.rotor), round(SETTLE / STEP)
    angle, torque = np.empty((2, len(target), count))
    last, asked, summed = target[0], np.zeros(count), np.zeros(count)
    before, transmitted, sigmoid = np.zeros(count), np.zeros(count), plant.friction.sigmoid.any()
    for row in range(-settling, len(target)):
        q, v, wanted = drives @ data.qpos + zero, drives @ data.qvel, target[max(row, 0)]
        most = plant.friction.most(max(row, 0) * STEP, v, transmitted)
        wanted_speed, last, error = (wanted - last) / STEP, wanted, wanted - q
        summed = summed + STEP * integral * error
        asked = _within(position * error + speed * (wanted_speed - v) + summed, plant.limit)
        summed = _within(summed, plant.limit)
        outside = plant.ripple * np.sin(plant.cycles * q + plant.phase) - plant.spring * (q - plant.rest)
        if sigmoid:
            outside += plant.friction.smooth(v)
        applied = plant.strength * asked + outside
        acceleration, before = (v - before) / STEP, v
        transmitted = applied - np.sign(v) * most - plant.friction.viscous * v - plant.rotor * acceleration
        model.tendon_frictionloss[:] = np.maximum(most, 1e-6)
        data.ctrl[:] = applied
        if row >= 0:
            angle[row], torque[row] = q, asked
        mujoco.mj_step(model, data)
    if not np.isfinite(angle).all() or np.abs(data.warning.number).sum():
        raise ArithmeticError(f"{plant.arm.name}: the simulation is unstable")
    return Run(np.arange(len(target)) * STEP, angle, torque)


def _within(values: Array, limit: Array) -> Array:
    """``np.clip``, which takes three times as long."""
    return np.minimum(np.maximum(values, -limit), limit)


def compiled(plant: Plant) -> tuple[mujoco.MjModel, Array, Array]:
    """MuJoCo's model; (n, coordinates) drive angles per coordinate; (n,) what they read where the coordinates are 0."""
    arm, springy = plant.arm, plant.springy
    spec = mujoco.MjSpec.from_string(urdf(arm, friction=False, springy=springy))
    spec.compiler.fusestatic = False
    _load(spec, plant)
    turn = np.linalg.inv(arm.to_joints)
    moved_by = [f"motor{k}" if k == springy else f"joint{k}" for k in range(1, len(arm.joints) + 1)]
    for number, row in enumerate(turn, 1):
        tendon = spec.add_tendon(name=f"drive{number}")
        for name, share in zip(moved_by, row):
            if share:
                tendon.wrap_joint(name, float(share))
        spec.add_actuator(name=f"drive{number}", trntype=mujoco.mjtTrn.mjTRN_TENDON, target=f"drive{number}")
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    roll, pitch = plant.tilt
    # gravity as the tilted base feels it: the base is turned by Rot(y, pitch) Rot(x, roll)
    down = -GRAVITY * np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    model.opt.gravity[:] = down
    model.tendon_armature[:], model.tendon_damping[:] = plant.rotor, plant.friction.viscous
    # a stiff constraint: friction reaches its level some mm/s from rest, not 0.1 rad/s as by default
    model.tendon_solref_fri[:] = (2 * STEP, 1.0)
    model.tendon_solimp_fri[:, :2] = (0.95, 0.99)
    if springy is not None:
        _soften(model, plant)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    drives = np.zeros((len(arm.joints), model.nv))
    for column, name in enumerate(moved_by):
        drives[:, model.jnt_dofadr[model.joint(name).id]] = turn[:, column]
    return model, drives, turn @ plant.zero


def _load(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Fixes payload and extra piece to their links, as bodies of their own."""
    if plant.payload is not None:
        mass, com, inertia = plant.payload
        link = spec.body(f"link{len(plant.arm.joints)}")
        link.add_body(name="payload", mass=mass, ipos=com, inertia=inertia, explicitinertial=True)
    if plant.extra is not None:
        number, mass, com = plant.extra
        small = 0.4 * mass * 0.03**2 * np.ones(3)
        spec.body(f"link{number}").add_body(name="piece", mass=mass, ipos=com, inertia=small, explicitinertial=True)


def _soften(model: mujoco.MjModel, plant: Plant) -> None:
    """The joint behind the springy drive deflects by a spring, or moves freely within a gap between stiff stops."""
    joint = model.joint(f"joint{plant.springy}").id
    place = model.jnt_dofadr[joint]
    if plant.gap:
        model.jnt_limited[joint], model.jnt_range[joint] = 1, (-plant.gap, plant.gap)
        model.jnt_solref[joint], model.jnt_solimp[joint][:3] = (0.003, 1.0), (0.99, 0.999, 1e-4)
        model.dof_damping[place] = plant.damping
    else:
        model.jnt_stiffness[joint], model.dof_damping[place] = plant.stiffness, plant.damping


def _inertia(model: mujoco.MjModel, data: mujoco.MjData, drives: Array) -> Array:
    """(n,) that each drive feels at the pose, without its rotor."""
    rotors, model.tendon_armature[:] = model.tendon_armature.copy(), 0.0
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    model.tendon_armature[:] = rotors
    moved = np.linalg.pinv(drives)
    return np.diag(moved.T @ full @ moved)
