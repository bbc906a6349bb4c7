"""The plant at work on an experiment: setpoints, servos, motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from experiment import Experiment, demand_of
from tests.blind.second.laboratory import Laboratory, arm_of, feed_forward, holding, plant_of, servo_of
from tests.blind.second.plant import Plant, motion

SETTLING = 1.0
"""s before the first row, standing."""
STEP = 1.3e-4
"""s: of an integration step at most."""


@dataclass(frozen=True)
class Motion:
    """At times t (m,) s, from before 0 on: motor and link angles and currents (m, n); setpoints by ``demand``."""

    t: Array
    angle: Array
    link: Array
    current: Array
    setpoints: Array
    targets: Array
    duration: float

    def demand(self, t: Array) -> Array:
        """(k, n) rad: straight lines between setpoints."""
        return np.column_stack([np.interp(t, self.setpoints, column) for column in self.targets.T])


def simulated(where: Laboratory, plant: Plant, experiment: Experiment) -> Motion:
    """The motion of an arm that may have something hidden; its servos are tuned to the healthy one."""
    healthy = plant_of(where, arm_of(where))
    servo, plan = servo_of(where, healthy), demand_of(experiment)
    phase = np.random.default_rng([where.seed, 995]).uniform(0.0, where.setpoint_period)
    setpoints = np.arange(-SETTLING - where.setpoint_period, plan.duration + 0.1, where.setpoint_period) + phase
    targets = plan(setpoints)
    ticks = np.arange(-SETTLING, plan.duration + 0.01, where.servo_period)
    demand = np.column_stack([np.interp(ticks, setpoints, column) for column in targets.T])
    # motors are asked for what turns the links to their demands
    motors = demand @ np.linalg.inv(plant.coupling).T
    ahead = np.searchsorted(setpoints, ticks, side="right").clip(1, len(setpoints) - 1)
    slope = (targets[ahead] - targets[ahead - 1]) / where.setpoint_period @ np.linalg.inv(plant.coupling).T
    parts = int(np.ceil(where.servo_period / STEP))
    extra = feed_forward(where, healthy, demand)
    first = holding(plant, demand[0]) / plant.drive
    angle, link, current = motion(plant, servo, ticks[0], motors, slope, extra, first, parts)
    t = ticks[0] + where.servo_period / parts * np.arange(len(angle))
    return Motion(t, angle, link, current, setpoints, targets, plan.duration)
