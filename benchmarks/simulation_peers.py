"""The same servoed arm in other simulators.

Pinocchio and MuJoCo stepped from Python, numba and JAX on our printed equations.

Every peer gets the demands at the servo's ticks and returns the motor angles there, so that they can be held against
ours. Servo as ``arm_model.description.Controller`` says; classical Runge-Kutta, one step a tick, except MuJoCo (its own
semi-implicit step).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body import newton_euler
from arm_model.rigid_body.inertia import about_com, tensor
from arm_model.rigid_body.numeric import bodies
from arm_model.servo import servo_gains
from arm_model.simulation.simulation import simulate_batch, system_of
from arm_model.symbolic.printing import python_function
from arm_model.system.dynamics import inverse_dynamics
from arm_model.system.kernel_inputs import numbers


@dataclass(frozen=True)
class Servo:
    """Numbers of the servo and of the drives, by joint."""

    kp: Array
    ki: Array
    kd: Array
    drive: Array
    limit: Array
    period: float
    share: float
    lag: float
    ahead: float
    viscous: Array
    mean: Array
    difference: Array
    width: Array

    def friction(self, v: Array) -> Array:
        s = v / np.sqrt(v * v + self.width * self.width)
        return self.viscous * v + (self.mean + self.difference * s) * s


def servo_of(arm: Arm) -> Servo:
    gains, controller, n = servo_gains(arm), arm.controller, range(len(arm))
    assert controller is not None and controller.velocity_bandwidth is not None
    given = {name: float(value[0]) for name, value in numbers(arm).items()}
    by_joint = {
        name: np.array([given[f"{name}{j}"] for j in n])
        for name in ("drive", "limit", "viscous_mean", "coulomb_mean", "coulomb_difference", "sign_velocity")
    }
    return Servo(
        kp=gains.position,
        ki=gains.integral,
        kd=gains.velocity,
        drive=by_joint["drive"],
        limit=by_joint["limit"],
        period=controller.servo_period,
        share=1 - math.exp(-controller.velocity_bandwidth * controller.servo_period),
        lag=controller.current_lag,
        ahead=controller.velocity_reference,
        viscous=by_joint["viscous_mean"],
        mean=by_joint["coulomb_mean"],
        difference=by_joint["coulomb_difference"],
        width=by_joint["sign_velocity"],
    )


def _looped(arm: Arm, demands: Array, advance: Callable[[Array, Array, Array, Array], tuple[Array, Array]]) -> Array:
    """(ticks, n) angles at every tick; ``advance``(q, v, current, command) makes one step in Python."""
    s, q = servo_of(arm), demands[0].copy()
    v = np.zeros_like(q)
    current = inverse_dynamics(arm, q, v, v)[0] / s.drive
    integral, last, speed, before = current.copy(), q.copy(), v.copy(), demands[0]
    shown = np.empty_like(demands)
    for tick, demand in enumerate(demands):
        shown[tick] = q
        error = demand - q
        integral = integral + s.ki * s.period * error
        speed = speed + s.share * ((q - last) / s.period - speed)
        command = s.kp * error + integral + s.kd * (s.ahead * (demand - before) / s.period - speed)
        command = np.clip(command, -s.limit, s.limit)
        last, before = q.copy(), demand
        q, v = advance(q, v, current, command)
        current = command + (current - command) * math.exp(-s.period / s.lag)
    return shown


def pinocchio(arm: Arm) -> Callable[[Array], Array]:
    """Stepped from Python with pin.aba."""
    import pinocchio as pin

    model, chain, s = pin.Model(), newton_euler.chain_of(arm), servo_of(arm)
    model.gravity.linear = np.array(arm.gravity)
    parent = 0
    for j, body in enumerate(bodies(arm)):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(chain.rotation[j], chain.shift[j]), f"joint{j}")
        mass, com, (x, y, z, xy, yz, xz) = about_com(body)
        inertia = tensor(np.array([x, xy, xz, y, yz, z]))
        model.appendBodyToJoint(parent, pin.Inertia(mass, np.array(com), inertia), pin.SE3.Identity())
    model.armature = arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia")
    data, h = model.createData(), s.period

    def advance(q: Array, v: Array, current: Array, command: Array) -> tuple[Array, Array]:
        def rate(q: Array, v: Array, time: float) -> Array:
            flowing = command + (current - command) * math.exp(-time / s.lag)
            return np.asarray(pin.aba(model, data, q, v, s.drive * flowing - s.friction(v)))

        a1 = rate(q, v, 0.0)
        v2 = v + h / 2 * a1
        a2 = rate(q + h / 2 * v, v2, h / 2)
        v3 = v + h / 2 * a2
        a3 = rate(q + h / 2 * v2, v3, h / 2)
        v4 = v + h * a3
        a4 = rate(q + h * v3, v4, h)
        return q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)

    return lambda demands: _looped(arm, demands, advance)


def mujoco_model(arm: Arm, step: float) -> Any:
    """The rigid links with reflected rotors, torque motors, no friction."""
    import mujoco

    spec, chain = mujoco.MjSpec(), newton_euler.chain_of(arm)
    spec.option.gravity, spec.option.timestep = arm.gravity, step
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    body = spec.worldbody
    for j, parameters in enumerate(bodies(arm)):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, chain.rotation[j].ravel())
        body = body.add_body(pos=chain.shift[j], quat=quaternion)
        joint = arm.joints[j]
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.revolute else mujoco.mjtJoint.mjJNT_SLIDE
        body.add_joint(name=f"j{j}", type=kind, axis=[0, 0, 1], armature=joint.ratio**2 * joint.rotor_inertia)
        mass, com, (x, y, z, xy, yz, xz) = about_com(parameters)
        body.mass, body.ipos, body.explicitinertial = mass, com, True
        body.fullinertia = [x, y, z, xy, xz, yz]
        actuator = spec.add_actuator(name=f"m{j}", target=f"j{j}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gainprm[0] = 1.0
    return spec.compile()


def mujoco_stepped(arm: Arm) -> Callable[[Array], Array]:
    """Stepped from Python with mj_step; friction and the mean current of each step go in as applied torques."""
    import mujoco

    s = servo_of(arm)
    model = mujoco_model(arm, s.period)
    data = mujoco.MjData(model)
    mean = s.lag / s.period * (1 - math.exp(-s.period / s.lag))

    def advance(q: Array, v: Array, current: Array, command: Array) -> tuple[Array, Array]:
        data.qpos, data.qvel = q, v
        data.qfrc_applied = s.drive * (command + (current - command) * mean) - s.friction(v)
        mujoco.mj_step(model, data)
        return data.qpos.copy(), data.qvel.copy()

    return lambda demands: _looped(arm, demands, advance)


_LOOP = """
def loop(demands, p, x, current, kp, ki, kd, limit, period, share, half, ahead):
    ticks, n = demands.shape
    shown = empty((ticks, n))
    integral, last, before = current.copy(), x[:n].copy(), demands[0].copy()
    speed, command = zeros(n), zeros(n)
    for tick in range(ticks):
        for j in range(n):
            shown[tick, j] = x[j]
            error = demands[tick, j] - x[j]
            integral[j] += ki[j] * period * error
            speed[j] += share * ((x[j] - last[j]) / period - speed[j])
            ahead_rate = ahead * (demands[tick, j] - before[j]) / period
            demanded = kp[j] * error + integral[j] + kd[j] * (ahead_rate - speed[j])
            command[j] = min(max(demanded, -limit[j]), limit[j])
            last[j], before[j] = x[j], demands[tick, j]
        middle = command + (current - command) * half
        end = command + (middle - command) * half
        k1 = array(rates(x, current, p))
        k2 = array(rates(x + period / 2 * k1, middle, p))
        k3 = array(rates(x + period / 2 * k2, middle, p))
        k4 = array(rates(x + period * k3, end, p))
        x = x + period / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        current = end
    return shown

def batch(demands, ps, x, currents, kp, ki, kd, limit, period, share, half, ahead):
    out = empty((len(ps), demands.shape[1]))
    for lane in prange(len(ps)):
        out[lane] = loop(demands, ps[lane], x, currents[lane], kp, ki, kd, limit, period, share, half, ahead)[-1]
    return out
"""


@dataclass(frozen=True)
class Printed:
    """Our rates as Python source rates(x, current, p), and the values of p and of the start for every lane."""

    source: str
    p: Array  # (lanes, P)
    x: Array  # (2 n,)
    currents: Array  # (lanes, n)


def printed(arm: Arm, variations: dict[str, Array], start: Array) -> Printed:
    system, given = system_of(arm, variations), numbers(arm, variations)
    used = [node.name for node in system.tape.nodes if node.operation == "input" and node.name in given]
    used = list(dict.fromkeys(used))
    names = {name: f"p[{k}]" for k, name in enumerate(used)} | {s: f"x[{k}]" for k, s in enumerate(system.states)}
    names |= {f"current{j}": f"current[{j}]" for j in range(system.joints)}
    still = simulate_batch(arm, lambda t: np.tile(start, (len(t), 1)), np.zeros(1), parameters=variations)
    return Printed(
        python_function("rates", ["x", "current", "p"], system.tape, system.rates, names),
        np.stack([given[name] for name in used], axis=1),
        np.concatenate([start, 0 * start]),
        still.current[:, 0],
    )


def _arguments(arm: Arm) -> tuple[Any, ...]:
    s = servo_of(arm)
    return s.kp, s.ki, s.kd, s.limit, s.period, s.share, math.exp(-s.period / 2 / s.lag), s.ahead


def numba_loops(arm: Arm, code: Printed) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """(one lane -> (ticks, n), all lanes on all cores -> (lanes, n) at the end), scalar code of numba."""
    import numba

    space: dict[str, Any] = {
        "sin": math.sin,
        "cos": math.cos,
        "sqrt": math.sqrt,
        "exp": math.exp,
        "minimum": min,
        "maximum": max,
        "array": np.array,
        "empty": np.empty,
        "zeros": np.zeros,
        "prange": numba.prange,
    }
    exec(code.source + _LOOP, space)
    space["rates"] = numba.njit(fastmath={"contract"}, error_model="numpy")(space["rates"])
    space["loop"] = numba.njit(error_model="numpy")(space["loop"])
    batch = numba.njit(parallel=True, error_model="numpy")(space["batch"])
    rest = _arguments(arm)
    return (
        lambda demands: space["loop"](demands, code.p[0], code.x, code.currents[0], *rest),
        lambda demands: batch(demands, code.p, code.x, code.currents, *rest),
    )


def jax_batch(arm: Arm, code: Printed) -> Callable[[Array], Array]:
    """All lanes by vmap over a scan over ticks, 64 bit, on the processor; -> (lanes, n) at the end."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    space: dict[str, Any] = {name: getattr(jnp, name) for name in ("sin", "cos", "sqrt", "exp", "minimum", "maximum")}
    exec(code.source, space)
    kp, ki, kd, limit, period, share, half, ahead = _arguments(arm)
    n = len(arm)

    def rates(x: Any, current: Any, p: Any) -> Any:
        return jnp.stack(space["rates"](x, current, p))

    def one(p: Any, current: Any, demands: Any) -> Any:
        def tick(carry: Any, demand: Any) -> Any:
            x, current, integral, last, speed, before = carry
            error = demand - x[:n]
            integral = integral + ki * period * error
            speed = speed + share * ((x[:n] - last) / period - speed)
            command = kp * error + integral + kd * (ahead * (demand - before) / period - speed)
            command = jnp.clip(command, -limit, limit)
            middle = command + (current - command) * half
            end = command + (middle - command) * half
            k1 = rates(x, current, p)
            k2 = rates(x + period / 2 * k1, middle, p)
            k3 = rates(x + period / 2 * k2, middle, p)
            k4 = rates(x + period * k3, end, p)
            after = x + period / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            return (after, end, integral, x[:n], speed, demand), None

        x = jnp.asarray(code.x)
        carry = (x, current, current, x[:n], jnp.zeros(n), demands[0])
        (x, *_), _ = jax.lax.scan(tick, carry, demands[:-1])
        return x[:n]

    run = jax.jit(jax.vmap(one, in_axes=(0, 0, None)))
    p, currents = jnp.asarray(code.p), jnp.asarray(code.currents)
    return lambda demands: np.asarray(run(p, currents, jnp.asarray(demands)).block_until_ready())
