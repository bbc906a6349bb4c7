"""What a model file says: joints, parameters, base and effects."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from arm_io import InputError, counted
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from arm_model.rigid_body import drive_mass_matrix
from arm_model.simulation import system_of
from arm_model.symbolic import operations
from arm_model.tables import FloatingBase
from arm_report import text_table

HEADS = ("joint", "name", "type", "mass", "inertia at q = 0", "viscous + / -", "Coulomb + / -")
"""Of the joints; the inertia is with the rotor."""


def summary(arm: Arm) -> dict[str, Any]:
    """Joints with friction and inertia, base, effects, and how much the equations cost: plain data, for JSON.

    ``not_simulated``: why the model cannot be simulated (the cost is None then), or None.
    """
    cost, not_simulated = _cost(arm)
    diagonal = drive_mass_matrix(arm, np.zeros(len(arm)))[0].diagonal()
    joints = [
        {
            "joint": number,
            "name": joint.name,
            "type": joint.type,
            "mass": joint.mass,
            "inertia_at_zero": float(diagonal[number - 1]),
            "gear": joint.gear,
            "viscous": [joint.ratio**2 * value for value in joint.viscous],
            "coulomb": [joint.ratio * value for value in joint.coulomb],
            "friction_curve": None if joint.friction_curve is None else asdict(joint.friction_curve),
            "drag": joint.drag,
            "link_viscous": joint.link_viscous,
            "link_coulomb": joint.link_coulomb,
            "cylinder": None if joint.cylinder is None else asdict(joint.cylinder),
        }
        for number, joint in enumerate(arm.joints, 1)
    ]
    effects = [
        {"effect": term.name, "joint": term.joint, "parameters": term.parameters, "units": _units(arm, term)}
        for term in arm.effects
    ]
    controller = None if arm.controller is None else arm.controller.kind
    return {
        "name": arm.name,
        "joints": joints,
        "controller": controller,
        "base": None if arm.floating is None else _base(arm.floating),
        "effects": effects,
        **cost,
        "not_simulated": not_simulated,
    }


def _cost(arm: Arm) -> tuple[dict[str, int | None], str | None]:
    """Operations of the rates and count of states; and why there are none."""
    try:
        system = system_of(arm)
    except InputError as error:
        return {"operations": None, "states": None}, error.what
    return {"operations": operations(system.tape, system.rates), "states": len(system.states)}, None


def summary_text(summary: dict[str, Any]) -> str:
    """The same for people, with units."""
    count = len(summary["joints"])
    lines = [
        f"{summary['name']}: {counted(count, 'joint')}, controller: {summary['controller'] or 'none'}",
        f"cannot be simulated: {summary['not_simulated']}"
        if summary["not_simulated"]
        else f"{summary['operations']} operations for the rates of {summary['states']} states",
        *([] if summary["base"] is None else [_base_text(summary["base"])]),
        "",
        *text_table([_row(joint) for joint in summary["joints"]], HEADS, numbers=(0, 3, 4, 5, 6), keep=(0, 1)),
    ]
    turning, sliding = (any(joint["type"] == kind for joint in summary["joints"]) for kind in ("revolute", "prismatic"))
    lines.append("units: kg" + ", kg m2, N m s/rad, N m" * turning + "; prismatic: kg, N s/m, N" * sliding)
    for joint in summary["joints"]:
        if body := joint["cylinder"]:
            coefficients = (
                f"C_d {body['drag_coefficient']:g}, C_a {body['added_mass_coefficient']:g}, "
                f"buoyancy {body['buoyancy']:g}"
            )
            lines.append(f"link {joint['joint']} in water: cylinder of {body['radius']:g} m, {coefficients}")
        if curve := joint["friction_curve"]:
            torques = [torque for way in ("positive", "negative") for torque in curve[way]]
            lines.append(
                f"joint {joint['joint']}: friction curve beside them, {min(torques):.3g} to {max(torques):.3g} at "
                f"{len(curve['speed'])} speeds up to {curve['speed'][-1]:.3g} rad/s (m/s)"
            )
        if joint["drag"]:
            unit = "N m s2/rad2" if joint["type"] == "revolute" else "N s2/m2"
            lines.append(f"joint {joint['joint']}: drag {joint['drag']:g} {unit}")
        if joint["link_viscous"] or joint["link_coulomb"]:
            units = ("N m", "N m s/rad") if joint["type"] == "revolute" else ("N", "N s/m")
            sizes = (f"{joint[name] or 0.0:g}" for name in ("link_coulomb", "link_viscous"))
            values = ", ".join(f"{size} {unit}" for size, unit in zip(sizes, units))
            lines.append(f"joint {joint['joint']}: friction of its own axis {values}")
    for term in summary["effects"]:
        law, units = CATALOGUE[term["effect"]], term["units"]
        values = ", ".join(law[name].in_words(value, units[name]) for name, value in term["parameters"].items())
        where = "arm" if term["joint"] is None else f"joint {term['joint']}"
        lines.append(f"effect {term['effect']} ({where}): {values}")
    return "\n".join(lines)


def _units(arm: Arm, term: EffectTerm) -> dict[str, str]:
    """Unit of each parameter of an effect, as its joint has it."""
    units = {name: CATALOGUE[term.name][name].unit for name in term.parameters}
    if term.joint is None:
        return units
    return {name: arm.joints[term.joint - 1].unit(unit, name) for name, unit in units.items()}


def _base(floating: FloatingBase) -> dict[str, Any]:
    """A floating base; ``restrained``: degrees of freedom that its thrusters push on."""
    pushed = np.linalg.matrix_rank(floating.allocation) if floating.thruster else 0
    return {
        "mass": floating.mass,
        "displaced_mass": floating.displaced_mass,
        "added_mass": floating.added.diagonal().tolist(),
        "thrusters": len(floating.thruster),
        "restrained": int(pushed),
        "station_keeping": floating.controller is not None,
    }


def _base_text(base: dict[str, Any]) -> str:
    added = ", ".join(f"{value:.4g}" for value in base["added_mass"])
    held = "station keeping" if base["station_keeping"] else "no controller"
    return (
        f"floating base of {base['mass']:g} kg that displaces {base['displaced_mass']:g} kg of water, "
        f"added mass {added}; {base['thrusters']} thrusters on {base['restrained']} degrees of freedom, {held}"
    )


def _row(joint: dict[str, Any]) -> tuple[str, ...]:
    viscous, coulomb = (" / ".join(f"{value:.4g}" for value in joint[kind]) for kind in ("viscous", "coulomb"))
    sizes = (f"{joint['mass']:.4g}", f"{joint['inertia_at_zero']:.4g}")
    return str(joint["joint"]), joint["name"], joint["type"], *sizes, viscous, coulomb
