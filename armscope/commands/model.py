"""``armscope model``: what a model file says, its equations as text or source, URDF and MuJoCo models in and out."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from arm_io import InputError
from arm_model import Arm, on_fixed_base, read_model, write_model
from arm_model.mjcf import SUFFIXES
from arm_model.symbolic import Expr, Tape
from arm_model.tables import FloatingBase
from arm_report import text_table, wrapped
from armscope.api.reading import note_gaps
from armscope.commands.options import Json
from armscope.progress import shown

HEADS = ("joint", "name", "type", "mass", "inertia at q = 0", "viscous + / -", "Coulomb + / -")
"""Of the joints; the inertia is with the rotor."""


class Form(StrEnum):
    """How equations are printed."""

    TEXT = "text"
    LATEX = "latex"
    PYTHON = "python"
    C = "c"


class Formulation(StrEnum):
    """The ways to the equations."""

    NEWTON_EULER = "newton-euler"
    LAGRANGE = "lagrange"
    KANE = "kane"


def command(
    model: Annotated[
        Path | None,
        typer.Argument(
            help="the arm: a model file (.toml), a URDF file (.urdf) or a MuJoCo model (.xml)", show_default=False
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="write the arm as .toml or .urdf; with --into as that file")] = None,
    equations: Annotated[Form | None, typer.Option(help="print the accelerations: text, latex, python or c")] = None,
    by: Annotated[
        Formulation | None, typer.Option(help="with --equations: the torques of the rigid links, by this formulation")
    ] = None,
    formulations: Annotated[
        bool, typer.Option(help="compare Newton-Euler, Lagrange and Kane: operation count, generation time, difference")
    ] = False,
    effects: Annotated[
        bool, typer.Option(help="list the effects that a model may have, with their parameters; needs no model")
    ] = False,
    into: Annotated[
        Path | None,
        typer.Option(
            metavar="ARM.urdf|ARM.xml",
            help="with --out: this URDF or MuJoCo file with the numbers of the model, all else kept",
        ),
    ] = None,
    tip: Annotated[str | None, typer.Option(help="last link or body, of a URDF or MuJoCo file that branches")] = None,
    as_json: Json = False,
) -> None:
    if effects:
        _catalogue(as_json)
        return
    if model is None:
        raise InputError("model", "needs a model file, as config/models/puma560.toml")
    arm = _read(model, tip if into is None else None)
    note_gaps(model, "dynamics", "collisions", tip=tip)
    for what, asked in (
        ("--formulations", formulations),
        ("--by", by is not None),
        ("--into", into is not None),
        ("a URDF file", out is not None and out.suffix == ".urdf"),
    ):
        if asked:
            on_fixed_base(arm, model, what)
    if into is not None:
        _update(into, arm, out, tip)
    elif out is not None:
        _write(out, arm)
        if model.suffix in (".urdf", *SUFFIXES) and out.suffix == ".toml":
            print(f"note: {_motors(out, arm)}", file=sys.stderr)
    if by is not None and equations is None:
        raise InputError("--by", "needs --equations text, latex, python or c")
    if equations is not None:
        print(_equations(arm, equations, by), end="")
        return
    if formulations:
        _compare(arm, as_json)
        return
    summary = _summary(arm)
    print(json.dumps(summary) if as_json else wrapped(_text(summary)))


def _motors(out: Path, arm: Arm) -> str:
    """What a person has to add to a model that comes from URDF or MJCF, which have no place for motors."""
    gears = "" if any(joint.gear != 1.0 for joint in arm.joints) else "gear (turns of the motor per turn) and "
    return (
        f"the file has no motors: add {gears}torque_constant (N m/A of the motor) to each [[joint]] of {out}; until "
        "then a current i counts as the torque of the joint, N m"
    )


def _read(path: Path, tip: str | None) -> Arm:
    if tip is None:
        return read_model(path)
    if path.suffix in SUFFIXES:
        from arm_model.mjcf import read_mjcf

        return read_mjcf(path, tip=tip)
    if path.suffix != ".urdf":
        raise InputError("--tip", f"names a link of a URDF file or a body of a MuJoCo model; {path} is neither")
    from arm_model.urdf import read_urdf

    return read_urdf(path, tip=tip)


def _update(original: Path, arm: Arm, out: Path | None, tip: str | None) -> None:
    """Writes a URDF file or MuJoCo model with the numbers of the arm; says on standard error what changed."""
    from arm_model.urdf import not_in_urdf

    if out is None or out.suffix != original.suffix:
        raise InputError("--into", f"needs --out NEW{original.suffix}")
    if original.suffix in SUFFIXES:
        from arm_model.mjcf import update_mjcf

        changed = update_mjcf(original, arm, out, tip=tip)
    else:
        from arm_model.urdf import update_urdf

        changed = update_urdf(original, arm, out, tip=tip)
    for line in changed or ["nothing changed"]:
        print(f"{out}: {line}", file=sys.stderr)
    for sentence in not_in_urdf(arm, "MJCF" if original.suffix in SUFFIXES else "URDF"):
        print(f"note: {sentence}", file=sys.stderr)


def _write(path: Path, arm: Arm) -> None:
    if path.suffix == ".urdf":
        from arm_model.urdf import not_in_urdf, write_urdf

        write_urdf(path, arm)
        for sentence in not_in_urdf(arm):
            print(f"note: {sentence}", file=sys.stderr)
    elif path.suffix == ".toml":
        write_model(path, arm)
    else:
        raise InputError(path, "must end in .toml or .urdf")


def _summary(arm: Arm) -> dict[str, Any]:
    from arm_model.rigid_body import drive_mass_matrix
    from arm_model.simulation import system_of
    from arm_model.symbolic import operations

    system = system_of(arm)
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
    effects = [{"effect": term.name, "joint": term.joint, "parameters": term.parameters} for term in arm.effects]
    controller = None if arm.controller is None else arm.controller.kind
    return {
        "name": arm.name,
        "joints": joints,
        "controller": controller,
        "base": None if arm.floating is None else _base(arm.floating),
        "effects": effects,
        "operations": operations(system.tape, system.rates),
        "states": len(system.states),
    }


def _text(summary: dict[str, Any]) -> str:
    lines = [
        f"{summary['name']}: {len(summary['joints'])} joints, controller: {summary['controller'] or 'none'}",
        f"{summary['operations']} operations for the rates of {summary['states']} states",
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
        values = ", ".join(f"{name} {value:g}" for name, value in term["parameters"].items())
        where = "arm" if term["joint"] is None else f"joint {term['joint']}"
        lines.append(f"effect {term['effect']} ({where}): {values}")
    return "\n".join(lines)


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


def _catalogue(as_json: bool) -> None:
    """Every effect of the vocabulary, as an [[effect]] table of a model file may have it."""
    from arm_model.effects import CATALOGUE

    if as_json:
        print(
            json.dumps(
                [
                    {
                        "effect": effect.name,
                        "place": effect.place.value,
                        "per_joint": effect.per_joint,
                        "equation": effect.equation,
                        "parameters": [
                            {
                                "name": p.name,
                                "unit": p.unit,
                                "typical": p.typical,
                                "linear": p.linear,
                                "meaning": p.meaning,
                                "signed": p.signed,
                                "whole": p.whole,
                                "search": p.search,
                            }
                            for p in effect.parameters
                        ],
                        "shows": effect.shows,
                        "confused_with": effect.confused_with,
                        "observed_by": list(effect.observed_by),
                        "excited_by": effect.excited_by,
                    }
                    for effect in CATALOGUE.values()
                ],
                allow_nan=False,
            )
        )
        return
    for effect in CATALOGUE.values():
        print(f"{effect.name} ({effect.place}, {'per joint' if effect.per_joint else 'whole arm'})")
        print(f"    {effect.equation}")
        for p in effect.parameters:
            low, high = p.typical
            typical = f"{low:g} to {high:g}" + (" of either sign" if p.signed else "")
            print(f"    {p.name:<20} {p.unit:<12} {typical:<28} {p.meaning}".rstrip())
        print(f"    observed by {', '.join(effect.observed_by)}; excited by {effect.excited_by}")
        print()


def _compare(arm: Arm, as_json: bool) -> None:
    from arm_model.formulations import SYMPY_JOINTS, compare

    with shown(as_json) as progress:
        progress("generating the equations, several ways")
        rows = compare(arm)
    if as_json:
        print(json.dumps({"name": arm.name, "formulations": [asdict(row) for row in rows]}))
        return
    print(f"{arm.name}: {len(arm)} joints, rigid links; difference of the torques on 100 random states, relative")
    print(f"{'formulation':<23}{'tau(q, qd, qdd)':>15}{'mass matrix, bias':>19}{'generated in':>14}{'difference':>12}")
    for row in rows:
        torque = "" if row.torque_operations is None else f"{row.torque_operations} op"
        system = f"{row.system_operations} op"
        print(f"{row.name:<23}{torque:>15}{system:>19}{row.seconds * 1e3:>11.1f} ms{row.difference:>12.1e}")
    if len(arm) > SYMPY_JOINTS:
        print(f"(sympy's methods are compared for up to {SYMPY_JOINTS} joints only; for more they take minutes)")


def _equations(arm: Arm, form: Form, by: Formulation | None) -> str:
    """The accelerations as they are compiled, or the torques of the rigid links by one formulation."""
    from arm_model.symbolic import latex, needed, printing

    what, tape, outputs = _accelerations(arm) if by is None else _torques(arm, by)
    nodes = [tape.nodes[index] for index in needed(tape, outputs.values())]
    read = {node.name: printing.shown(node.name) for node in nodes if node.operation == "input"}
    if form is Form.LATEX:
        # that the rate of an angle is a speed is in the notation
        computed = {name: value for name, value in outputs.items() if tape.nodes[value.index].operation != "input"}
        written = latex.equations(tape, {latex.output_symbol(name): value for name, value in computed.items()})
        return written + "\n% with the values of the model, regrouped:\n" + _listed(arm, read, "% {} = {}\n")
    if form is Form.TEXT:
        equations = printing.equations(tape, {_left(name): value for name, value in outputs.items()}, read)
        return equations + "\n\nwith the values of the model, regrouped:\n" + _listed(arm, read, "{} = {}\n")
    legal = {name: text.replace(".", "_") for name, text in read.items()}
    python = form is Form.PYTHON
    write: Callable[..., str] = printing.python_function if python else printing.c_function
    arguments = [name if python else f"double {name}" for name in legal.values()]
    order = f"out of {what}, in order: {', '.join(_left(name) for name in outputs)}"
    imported = f"from numpy import {', '.join(printing.PYTHON_FUNCTIONS)}\n\n"
    if python:
        values = _listed(arm, legal, '    "{}": {},\n')
        head = f"# {order}\n{imported}VALUES = {{\n{values}}}\n\n\n"
    else:
        values = _listed(arm, legal, "   {} = {}\n")
        head = f"/* {order}\n   with the values of the model, regrouped:\n{values}*/\n#include <math.h>\n\n"
    return head + write(what, arguments, tape, list(outputs.values()), legal)


def _listed(arm: Arm, names: Mapping[str, str], line: str) -> str:
    """The model's values of what its equations take, regrouped as they have it, a ``line`` of name and value each."""
    from arm_model.system import numbers

    given = numbers(arm)
    return "".join(line.format(text, repr(float(given[name][0]))) for name, text in names.items() if name in given)


def _left(name: str) -> str:
    """What stands left of the equals sign: "d speed0/dt" -> "d speed1/dt", "tau0" -> "tau1"."""
    from arm_model.symbolic import shown

    if not name.startswith("d "):
        return shown(name)
    return f"d {shown(name.removeprefix('d ').removesuffix('/dt'))}/dt"


def _accelerations(arm: Arm) -> tuple[str, Tape, dict[str, Expr]]:
    from arm_model.simulation import system_of

    system = system_of(arm)
    return "rates", system.tape, {f"d {name}/dt": rate for name, rate in zip(system.states, system.rates)}


def _torques(arm: Arm, by: Formulation) -> tuple[str, Tape, dict[str, Expr]]:
    from arm_model.formulations import TORQUES, symbols_of

    symbols = symbols_of(arm)
    return "torques", symbols.tape, {f"tau{j}": tau for j, tau in enumerate(TORQUES[by.value](symbols))}
