"""The files of docs/first-hour-own-arm.md: a small arm's URDF, and logs of its controller, made by MuJoCo.

``python -m tests.foreign.first_hour`` writes them to examples/own_arm. The arm is MuJoCo's: its friction, its damping,
its armature; a controller of ours holds it on its motion and logs angles and motor currents at 200 Hz. In the URDF the
masses are those of a drawing, 5 % off; friction and motors are not in it. On the second day joint 2 has more friction.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "own_arm"
RATE, STEP, SECONDS = 200, 0.0005, 16.0
GEAR, CONSTANT = (100.0, 80.0), (0.12, 0.08)
FRICTION = {"healthy": (6.0, 3.0), "today": (6.0, 4.5)}
"""N m per joint."""
RUNS = {"healthy": (1, 2), "today": (3, 4)}

URDF = """<?xml version="1.0"?>
<robot name="desk arm">
  <link name="base"/>
  <link name="upper_arm">
    <inertial>
      <origin xyz="0.18 0 0"/>
      <mass value="3.8"/>
      <inertia ixx="0.006" iyy="0.045" izz="0.045" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="forearm">
    <inertial>
      <origin xyz="0.13 0 0"/>
      <mass value="1.9"/>
      <inertia ixx="0.002" iyy="0.015" izz="0.015" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper_arm"/>
    <origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.6" upper="2.6" effort="150" velocity="2.5"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper_arm"/>
    <child link="forearm"/>
    <origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.6" upper="2.6" effort="60" velocity="2.5"/>
  </joint>
</robot>
"""
ARM = """<mujoco><option timestep="{step}" integrator="implicitfast"/><worldbody>
<body pos="0 0 0.3"><joint name="j1" axis="0 1 0" armature="0.9" damping="5" frictionloss="{f1}"/>
<inertial pos="0.18 0 0" mass="4" diaginertia="0.006 0.048 0.048"/>
<body pos="0.4 0 0"><joint name="j2" axis="0 1 0" armature="0.4" damping="2.5" frictionloss="{f2}"/>
<inertial pos="0.13 0 0" mass="2" diaginertia="0.002 0.016 0.016"/></body></body></worldbody>
<actuator><motor joint="j1"/><motor joint="j2"/></actuator></mujoco>"""


def motion(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,) and angles and speeds (n, 2): Fourier series of 0.2 Hz that begin and end at rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, STEP)
    w = 2 * np.pi * 0.2 * np.arange(1, 5)
    a, b = 0.45 * rng.normal(size=(2, 4, 2)) / np.arange(1, 5)[:, None] ** 0.7
    share = np.clip(np.minimum(t - 0.5, SECONDS - 0.5 - t), 0.0, 1.0)
    fade = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    q = np.array([-0.6, 0.8]) + fade[:, None] * (np.sin(np.outer(t, w)) @ a + np.cos(np.outer(t, w)) @ b)
    return t, q, np.gradient(q, STEP, axis=0)


def log(day: str, seed: int) -> np.ndarray:
    """(n, 7) t, q1, q2, i1, i2, qref1, qref2 of a run, as the controller logs it."""
    model = mujoco.MjModel.from_xml_string(ARM.format(step=STEP, f1=FRICTION[day][0], f2=FRICTION[day][1]))
    data, rng = mujoco.MjData(model), np.random.default_rng(100 + seed)
    t, q, v = motion(seed)
    data.qpos[:] = q[0]
    scale, rows, integral = np.array(GEAR) * np.array(CONSTANT), [], np.zeros(2)
    current = np.zeros(2)
    for k in range(len(t)):
        if k % 4 == 0:
            error = q[k] - data.qpos
            integral += 4 * STEP * error
            torque = np.array([2500.0, 900.0]) * error + np.array([120.0, 45.0]) * (v[k] - data.qvel)
            current = (torque + np.array([9000.0, 3200.0]) * integral) / scale
        if k % (1 / (RATE * STEP)) == 0:
            angle = np.round(data.qpos / 2e-5) * 2e-5
            rows.append([t[k], *angle, *(current + 0.03 * rng.standard_normal(2)), *q[k]])
        data.ctrl[:] = scale * current
        mujoco.mj_step(model, data)
    return np.array(rows)


def write(folder: Path) -> None:
    """arm.urdf and a CSV per run."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.urdf").write_text(URDF)
    for day, seeds in RUNS.items():
        for number, seed in enumerate(seeds, 1):
            lines = ["t,q1,q2,i1,i2,qref1,qref2"]
            lines += [",".join(f"{value:.5f}".rstrip("0").rstrip(".") for value in row) for row in log(day, seed)]
            (folder / f"{day}_{number}.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    write(FOLDER)
