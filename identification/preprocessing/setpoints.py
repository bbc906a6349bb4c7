"""How often a host sends setpoints to the servos: as the model states, as demands show, or as the currents show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from arm_io.types import Array
from arm_model import Arm
from identification.preprocessing.setpoints_in_currents import rows_against, rows_between_setpoints
from identification.preprocessing.setpoints_in_demands import setpoint_period

OFTEN = 1.5
"""Servo periods per setpoint above which servos work several times between two of these."""


@dataclass(frozen=True)
class Setpoints:
    """Setpoints every ``period`` s, and what says so; 0: nothing does, or there are none.

    Currents show whole numbers of rows per setpoint alone, and may show a multiple of the period: its lines are among
    those of the multiple. within: whether the model says that its servos work several times per setpoint, so that every
    one has a transient; elsewhere recorder and controller may run as one, and hold the currents between setpoints.
    """

    period: float = 0.0
    source: Literal["model", "demands", "currents"] = "model"
    within: bool = False

    def as_shown(self, signals: str) -> str:
        """For a message: ", as the demands (``signals``: currents) show"; empty where the model states them."""
        shown_by = {"model": "", "demands": "demands", "currents": signals}[self.source]
        return f", as the {shown_by} show" if shown_by else ""


UNKNOWN = Setpoints()


def stated_period(arm: Arm) -> float:
    """s between setpoints of the arm's controller; 0: the model has none."""
    return 0.0 if arm.controller is None else arm.controller.setpoint_period


def setpoints_of(
    arm: Arm,
    dt: float,
    *,
    demands: Array | None = None,
    currents: Callable[[], tuple[Array, Array]] | None = None,
) -> Setpoints:
    """The setpoints of a recording with rows ``dt`` s apart, by the first of three sources that knows them.

    The controller of the model, unless the currents refute it; the recorded ``demands`` (m, J) rad (m); the
    ``currents``: ripple (m, J) and acceleration (m, J) as of ``rows_between_setpoints``.
    """
    if (controller := arm.controller) is not None:
        within = controller.setpoint_period > OFTEN * controller.servo_period
        stated = Setpoints(controller.setpoint_period, within=within)
        rows = 0 if currents is None else rows_against(stated.period, *currents(), 1.0 / dt)
        return Setpoints(rows * dt, "currents") if rows else stated
    if demands is not None and (period := setpoint_period(demands, dt)):
        return Setpoints(period, "demands")
    if currents is not None and (rows := rows_between_setpoints(*currents(), 1.0 / dt)):
        return Setpoints(rows * dt, "currents")
    return UNKNOWN
