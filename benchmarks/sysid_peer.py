"""MuJoCo's own system identification (``mujoco.sysid``) on the EMPS recording.

It comes with mujoco 4 and needs the extra ``sysid``.

It simulates the closed loop and turns a model's numbers until simulated sensors look like measured ones (Gauss-Newton
by finite differences). What it can fit: whatever an MJCF model has, so masses, inertias, damping, frictionloss and
armature inside bounds that a person gives, and here the constant term of an actuator as an offset. What it cannot:
friction that differs by direction (an MJCF joint has one frictionloss and one damping), base parameters (which sums the
data shows is the user's to find: what it does not show ends up at a bound), gears and encoders that ripple; its
intervals take residuals for white. It needs the demand and a controller; the regression here needs neither.
"""

from __future__ import annotations

import contextlib
import io
import logging
import time
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm

NAMES = ("link1.mass", "joint1.viscous", "joint1.coulomb", "joint1.offset")
START, LEAST, MOST = 0.5, 0.2, 3.0  # of the published values: where the search begins, and its bounds


def installed() -> bool:
    """Whether ``mujoco.sysid`` and its requirements are here: without its extra, its names are missing."""
    try:
        from mujoco import sysid
    except ImportError:
        return False
    return hasattr(sysid, "optimize")


def fit_drive(
    arm: Arm, t: Array, q: Array, force: Array, demand: Array
) -> tuple[dict[str, float], dict[str, float], float]:
    """Parameters ``NAMES`` of a one-joint ``arm`` with cascade control.

    The half widths of their intervals at 95 %, and s taken.

    t, q, force, demand (m,): s from a start at rest, m, N, m.
    """
    import mujoco
    from mujoco import sysid

    logging.getLogger("absl").setLevel(logging.ERROR)
    joint = arm.joints[0]
    start = dict(zip(NAMES, (joint.mass, joint.viscous[0], joint.coulomb[0], joint.offset)))
    spec = mujoco.MjSpec.from_string(drive(arm, float(np.median(np.diff(t)))))
    model = spec.compile()
    data = mujoco.MjData(model)
    run = sysid.ModelSequences(
        "emps",
        spec,
        "measured",
        sysid.create_initial_state(model, np.array([q[0]]), data.qvel, data.act),
        sysid.TimeSeries(t, np.stack([demand, np.zeros(len(t))], axis=1)),
        sysid.TimeSeries.from_names(t, np.stack([q, force], axis=1), model),
    )
    parameters = sysid.ParameterDict()
    for (name, value), write in zip(start.items(), WRITE):
        low, high = sorted((LEAST * value, MOST * value))
        parameters.add(sysid.Parameter(name, START * value, low, high, modifier=write))
    residual = sysid.build_residual_fn(models_sequences=[run])
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its iterations whatever the options
        found, result = sysid.optimize(
            parameters, residual, verbose=False, optimizer="scipy_parallel_fd", x_scale="jac"
        )
    taken = time.perf_counter() - began
    half = sysid.calculate_intervals([np.ravel(part) for part in residual(result.x, found)[0]], np.asarray(result.jac))[
        1
    ]
    return dict(zip(NAMES, found.as_vector().tolist())), dict(zip(NAMES, half.tolist())), taken


def drive(arm: Arm, dt: float) -> str:
    """MJCF of one slide and its servo, with sensors of position and of the drive's force.

    force = clip(K Kv (Kp (demand - q) - v)); the offset is a second actuator's constant term, because MJCF joints have
    none. Euler's steps, since implicit ones would soften the sampled servo, and friction as stiff as the solver allows:
    with MuJoCo's defaults the mass comes out 15 % low.
    """
    joint, loop = arm.joints[0], arm.controller
    assert loop is not None and loop.kind == "cascade"
    damping = joint.drive_constant * loop.velocity_gain[0]
    stiffness = damping * loop.position_gain[0]
    return f"""
    <mujoco>
      <option timestep="{dt}" gravity="0 0 0"/>
      <worldbody>
        <body name="carriage">
          <inertial pos="0 0 0" mass="{joint.mass}" diaginertia="1 1 1"/>
          <joint name="slide" type="slide" axis="1 0 0" damping="{joint.viscous[0]}" frictionloss="{joint.coulomb[0]}"
                 solreffriction="{2 * dt} 1"/>
        </body>
      </worldbody>
      <actuator>
        <general name="servo" joint="slide" gainprm="{stiffness}" biastype="affine" biasprm="0 {-stiffness} {-damping}"
                 forcelimited="true" forcerange="{-joint.torque_limit} {joint.torque_limit}"/>
        <general name="offset" joint="slide" gainprm="0" biastype="affine" biasprm="{-joint.offset} 0 0"/>
      </actuator>
      <sensor>
        <jointpos name="position" joint="slide"/>
        <actuatorfrc name="force" actuator="servo"/>
      </sensor>
    </mujoco>"""


def _write_mass(spec: Any, parameter: Any) -> None:
    spec.body("carriage").mass = parameter.value[0]


def _write_viscous(spec: Any, parameter: Any) -> None:
    spec.joint("slide").damping[0] = parameter.value[0]


def _write_coulomb(spec: Any, parameter: Any) -> None:
    spec.joint("slide").frictionloss = parameter.value[0]


def _write_offset(spec: Any, parameter: Any) -> None:
    spec.actuator("offset").biasprm[0] = -parameter.value[0]


WRITE = (_write_mass, _write_viscous, _write_coulomb, _write_offset)
