"""The equations of an arm, as text or source."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from enum import StrEnum

from arm_model import Arm
from arm_model.simulation import system_of
from arm_model.symbolic import Expr, Tape, latex, needed, printing, shown
from arm_model.system import numbers


class Form(StrEnum):
    """How equations are printed."""

    TEXT = "text"
    LATEX = "latex"
    PYTHON = "python"
    C = "c"
    MATLAB = "matlab"


class Formulation(StrEnum):
    """The ways to the equations."""

    NEWTON_EULER = "newton-euler"
    LAGRANGE = "lagrange"
    KANE = "kane"


def equations_text(arm: Arm, form: Form, by: Formulation | None) -> str:
    """The accelerations as they are compiled, or the torques of the rigid links by one formulation."""
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
    if form is Form.MATLAB:
        return _matlab(arm, what, tape, outputs, legal)
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
    source = head + write(what, arguments, tape, list(outputs.values()), legal)
    return source if python else source + _c_of_arrays(arm, what, legal)


def _matlab(arm: Arm, what: str, tape: Tape, outputs: Mapping[str, Expr], legal: Mapping[str, str]) -> str:
    """A function file of matrices with a row per sample; without arguments it returns the values of the model."""
    given = numbers(arm)
    signals = dict.fromkeys(text.rstrip("0123456789") for name, text in legal.items() if name not in given)
    names = {
        name: f"p.{text}" if name in given else re.sub(r"(\d+)$", r"(:, \1)", text) for name, text in legal.items()
    }
    values = ", ...\n".join(_listed(arm, legal, "        '{}', {}\n").splitlines())
    return (
        f"function out = {what}({', '.join(['p', *signals])})\n"
        f"% out, in columns: {', '.join(_left(name) for name in outputs)}\n"
        f"% {', '.join(signals)}: a row per sample, a column per joint\n"
        f"% p = {what}(): the values of the model, regrouped\n"
        f"if nargin == 0\n    out = struct( ...\n{values});\n    return\nend\n"
        + printing.matlab_body([*signals][-1], tape, list(outputs.values()), names)
    )


def _c_of_arrays(arm: Arm, what: str, legal: Mapping[str, str]) -> str:
    """A C function of an array per signal that calls the one of all numbers with the values of the model."""
    given = numbers(arm)
    signals = dict.fromkeys(text.rstrip("0123456789") for name, text in legal.items() if name not in given)
    arguments = ", ".join([f"const double *{signal}" for signal in signals] + ["double *out"])
    taken = [repr(float(given[name][0])) if name in given else _entry(text) for name, text in legal.items()]
    return (
        f"\n/* the same with the values of the model; {', '.join(signals)}: an entry per joint, from 0 */\n"
        f"void {what}_of_model({arguments})\n{{\n    {what}({', '.join([*taken, 'out'])});\n}}\n"
    )


def _entry(text: str) -> str:
    """ "theta2" -> "theta[1]"; of a signal of the whole arm the first entry."""
    signal = text.rstrip("0123456789")
    return f"{signal}[{int(text.removeprefix(signal) or 1) - 1}]"


def _listed(arm: Arm, names: Mapping[str, str], line: str) -> str:
    """The model's values of what its equations take, regrouped as they have it, a ``line`` of name and value each."""
    given = numbers(arm)
    return "".join(line.format(text, repr(float(given[name][0]))) for name, text in names.items() if name in given)


def _left(name: str) -> str:
    """What stands left of the equals sign: "d speed0/dt" -> "d speed1/dt", "tau0" -> "tau1"."""
    if not name.startswith("d "):
        return shown(name)
    return f"d {shown(name.removeprefix('d ').removesuffix('/dt'))}/dt"


def _accelerations(arm: Arm) -> tuple[str, Tape, dict[str, Expr]]:
    system = system_of(arm)
    return "rates", system.tape, {f"d {name}/dt": rate for name, rate in zip(system.states, system.rates)}


def _torques(arm: Arm, by: Formulation) -> tuple[str, Tape, dict[str, Expr]]:
    from arm_model.formulations import TORQUES, symbols_of

    symbols = symbols_of(arm)
    return "torques", symbols.tape, {f"tau{j}": tau for j, tau in enumerate(TORQUES[by.value](symbols))}
