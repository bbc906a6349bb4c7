"""A tape as LaTeX: an align* of common parts and outputs, with the symbols that textbooks use; joints count from 1."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from arm_model.rigid_body.inertia import PARAMETERS
from arm_model.symbolic.printing import ATOM, POWER, PRODUCT, SUM, Term, written
from arm_model.symbolic.tape import Expr, Node, Tape

_MOMENTS = {"mass": "m", "mx": "mx", "my": "my", "mz": "mz"}
_OF_JOINT = {
    "tau": r"\tau_{{{}}}",
    "q": "q_{{{}}}",
    "qd": r"\dot q_{{{}}}",
    "qdd": r"\ddot q_{{{}}}",
    "theta": r"\theta_{{{}}}",
    "speed": r"\dot\theta_{{{}}}",
    "phi": r"\varphi_{{{}}}",
    "phi_speed": r"\dot\varphi_{{{}}}",
    "current": "i_{{{}}}",
    "drive": "k_{{{}}}",
    "rotor": "J_{{m,{}}}",
    "viscous_mean": "B_{{{}}}",
    "viscous_difference": "E_{{{}}}",
    "offset": "o_{{{}}}",
    "coulomb_mean": "F_{{{}}}",
    "coulomb_difference": "D_{{{}}}",
    "sign_velocity": "v_{{s,{}}}",
    "zero": "q_{{0,{}}}",
    "resistance": r"\rho C_d R_{{{}}}",
    "added": r"\rho C_a\pi R^2_{{{}}}",
    "displaced": "m_{{w,{}}}",
    "drag": "D_{{q,{}}}",
    "link_viscous": "B_{{q,{}}}",
    "link_coulomb": "F_{{q,{}}}",
    "internal": "z_{{{}}}",
    "damping": "c_{{{}}}",
}


def symbol(name: str) -> str:
    """The symbol of an input of a generated system.

    Names: ``arm_model.system.closed_loop_system``, ``arm_model.system.kernel_inputs``, ``arm_model.formulations``.
    """
    if name == "time":
        return "t"
    if name.startswith("gravity"):
        return f"g_{'xyz'[int(name[-1])]}"
    if body := re.fullmatch(r"body(\d+)\.(\d)", name):
        link, entry = int(body[1]) + 1, PARAMETERS[int(body[2])]
        return f"I_{{{entry[1:]},{link}}}" if entry.startswith("i") else f"{_MOMENTS[entry]}_{{{link}}}"
    if effect := re.fullmatch(r"effect(\d+)\.(\w+)", name):
        return rf"\mathrm{{{_words(effect[2])}}}_{{{int(effect[1]) + 1}}}"
    if curve := re.fullmatch(r"curve(\d+)\.(speed|positive|negative)(\d+)", name):
        letter = {"speed": "s", "positive": "b^+", "negative": "b^-"}[curve[2]]
        return f"{letter}_{{{int(curve[1]) + 1},{int(curve[3]) + 1}}}"
    kind, number = re.fullmatch(r"(\w+?)(\d*)", name).groups()  # type: ignore[union-attr]
    if kind in _OF_JOINT and number:
        return _OF_JOINT[kind].format(int(number) + 1)
    return rf"\mathrm{{{_words(name)}}}"


def _words(name: str) -> str:
    return name.replace("_", r"\ ")


def output_symbol(name: str) -> str:
    r"""The symbol of what is worked out: of tau0, or of the derivative of a state, \ddot\theta_1 of "d speed0/dt"."""
    if not name.startswith("d "):
        return symbol(name)
    text = symbol(name.removeprefix("d ").removesuffix("/dt"))
    return text.replace(r"\dot", r"\ddot") if r"\dot" in text else rf"\dot {text}"


def equations(tape: Tape, outputs: Mapping[str, Expr], symbols: Callable[[str], str] = symbol) -> str:
    """align* with t_1, t_2, ... for what is used more than once, then the outputs (LaTeX -> expression)."""
    common, values = written(tape, outputs, lambda node, terms: _value(node, terms, symbols), "t_{{{}}}".format)
    lines = [f"{name} &= {value}" for name, value in [*common, *values.items()]]
    return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}\n"


def _value(node: Node, values: list[Term], symbols: Callable[[str], str]) -> Term:
    plain = [value for value, _ in values]
    match node.operation:
        case "const":
            return _number(node.value), ATOM if node.value >= 0 else SUM
        case "input":
            return symbols(node.name), ATOM
        case "add":
            return f"{plain[0]} + {_bound(values[1], PRODUCT) if plain[1][0] == '-' else plain[1]}", SUM
        case "sub":
            return f"{plain[0]} - {_bound(values[1], PRODUCT)}", SUM
        case "mul" if node.arguments[0] == node.arguments[1]:
            return f"{{{_bound(values[0], ATOM)}}}^2", POWER
        case "mul":
            parts = sorted((_bound(value, PRODUCT) for value in values), key=lambda part: not part[0].isdigit())
            return (r" \cdot " if parts[1][0].isdigit() else r"\, ").join(parts), PRODUCT
        case "div":
            return rf"\frac{{{plain[0]}}}{{{plain[1]}}}", POWER
        case "neg":
            return f"-{_bound(values[0], PRODUCT)}", SUM
        case "rsqrt":
            return rf"\frac{{1}}{{\sqrt{{{plain[0]}}}}}", POWER
        case "sqrt":
            return rf"\sqrt{{{plain[0]}}}", ATOM
        case "exp":
            return rf"e^{{{plain[0]}}}", POWER
        case "log":
            return rf"\ln\left({plain[0]}\right)", ATOM
        case "abs":
            return rf"\left|{plain[0]}\right|", ATOM
        case "min" | "max":
            return rf"\{node.operation}\left({plain[0]}, {plain[1]}\right)", ATOM
    return rf"\{node.operation}\left({plain[0]}\right)", ATOM


def _bound(value: Term, at_least: int) -> str:
    return value[0] if value[1] >= at_least else rf"\left({value[0]}\right)"


def _number(value: float) -> str:
    """All digits that matter, and the power of ten as people write it."""
    mantissa, _, exponent = f"{value:.12g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa
