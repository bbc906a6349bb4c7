"""A tape as source: straight-line Python or C, or equations for people.

What is used more than once gets a name of its own (t1, t2, ...); everything else stands where it is used.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from arm_model.rigid_body.inertia import PARAMETERS
from arm_model.symbolic.tape import Expr, Node, Tape, needed

_INFIX = {"add": ("+", 1), "sub": ("-", 1), "mul": ("*", 2), "div": ("/", 2)}
SUM, PRODUCT, POWER, ATOM = 1, 2, 3, 4
"""How strongly a printed expression binds: what binds less than its surroundings stands in parentheses."""
Term = tuple[str, int]
"""Source of an expression, and how strongly it binds."""


def shown(name: str) -> str:
    """A name of a generated system.

    It counts from 0 (``arm_model.system.closed_loop_system``, ``arm_model.system.kernel_inputs``); people read joints
    and effects from 1, parameters of bodies and axes of gravity by their letters. theta0 -> theta1, body1.4 ->
    body2.ixx.
    """
    if body := re.fullmatch(r"body(\d+)\.(\d)", name):
        return f"body{int(body[1]) + 1}.{PARAMETERS[int(body[2])]}"
    if gravity := re.fullmatch(r"gravity(\d)", name):
        return f"gravity_{'xyz'[int(gravity[1])]}"
    if curve := re.fullmatch(r"curve(\d+)\.(\w+?)(\d+)", name):
        return f"curve{int(curve[1]) + 1}.{curve[2]}{int(curve[3]) + 1}"
    counted = re.fullmatch(r"([a-z_]+)(\d+)(\.\w+)?", name)
    return f"{counted[1]}{int(counted[2]) + 1}{counted[3] or ''}" if counted else name


@dataclass(frozen=True)
class Language:
    """Names of the functions of a tape, and how an assignment reads. rsqrt is written as 1 / sqrt.

    elementwise: mark before the signs of products and quotients of arrays
    """

    functions: Mapping[str, str]
    assign: str = "{name} = {value}"
    elementwise: str = ""


PYTHON = Language(
    {name: name for name in ("sin", "cos", "sqrt", "exp", "log", "abs")} | {"min": "minimum", "max": "maximum"}
)
PYTHON_FUNCTIONS = ("sin", "cos", "sqrt", "exp", "log", "abs", "minimum", "maximum")
"""What ``python_function`` needs in its namespace."""
C = Language(
    {name: name for name in ("sin", "cos", "sqrt", "exp", "log")} | {"abs": "fabs", "min": "fmin", "max": "fmax"},
    "const double {name} = {value};",
)

MATLAB = Language(
    {name: name for name in ("sin", "cos", "sqrt", "exp", "log", "abs", "min", "max")}, "{name} = {value};", "."
)


def written(
    tape: Tape,
    outputs: Mapping[str, Expr],
    value: Callable[[Node, list[Term]], Term],
    name: Callable[[int], str],
) -> tuple[list[tuple[str, str]], dict[str, str]]:
    """((name, source) of what is used more than once, in order; source of each output in terms of these).

    value: source of one operation on these; name: of the k-th common part, from 1.
    """
    order = needed(tape, outputs.values())
    uses = Counter(a for index in order for a in tape.nodes[index].arguments)
    uses.update(expr.index for expr in outputs.values())
    common: list[tuple[str, str]] = []
    terms: dict[int, Term] = {}
    for index in order:
        node = tape.nodes[index]
        terms[index] = value(node, [terms[a] for a in node.arguments])
        if uses[index] > 1 and node.operation not in ("const", "input"):
            common.append((name(len(common) + 1), terms[index][0]))
            terms[index] = common[-1][0], ATOM
    return common, {name: terms[expr.index][0] for name, expr in outputs.items()}


def assignments(
    tape: Tape, outputs: Mapping[str, Expr], language: Language, names: Mapping[str, str] | None
) -> tuple[list[str], dict[str, str]]:
    """(lines, value of each output): ``lines`` assign t1, t2, ... in order, the outputs are expressions in them.

    ``names`` renames inputs: input of the tape -> text in the source.
    """
    common, values = written(
        tape, outputs, lambda node, terms: _value(node, terms, language, names or {}), "t{}".format
    )
    return [language.assign.format(name=name, value=source) for name, source in common], values


def _value(node: Node, values: list[Term], language: Language, names: Mapping[str, str]) -> Term:
    if node.operation == "const":
        return repr(node.value), ATOM if node.value >= 0 else SUM
    if node.operation == "input":
        return names.get(node.name, node.name), ATOM
    if node.operation in _INFIX:
        sign, binds = _INFIX[node.operation]
        left = _bound(values[0], binds)
        right = _bound(values[1], binds + (node.operation in ("sub", "div")))
        return f"{left} {language.elementwise if binds == PRODUCT else ''}{sign} {right}", binds
    if node.operation == "neg":
        return f"-{_bound(values[0], PRODUCT)}", SUM
    if node.operation == "rsqrt":
        return f"1.0 {language.elementwise}/ {language.functions['sqrt']}({values[0][0]})", PRODUCT
    return f"{language.functions[node.operation]}({', '.join(value for value, _ in values)})", ATOM


def _bound(value: Term, at_least: int) -> str:
    return value[0] if value[1] >= at_least else f"({value[0]})"


def python_function(
    name: str, arguments: Sequence[str], tape: Tape, outputs: Sequence[Expr], names: Mapping[str, str] | None = None
) -> str:
    """Source of a Python function that returns the outputs as a tuple.

    It needs sin, cos, sqrt, exp, log, abs, minimum and maximum in its namespace: numpy's, math's or another library's.
    """
    lines, values = assignments(tape, {str(k): expr for k, expr in enumerate(outputs)}, PYTHON, names)
    body = [*lines, f"return ({', '.join(values.values())},)"]
    return f"def {name}({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in body)


def c_function(
    name: str, arguments: Sequence[str], tape: Tape, outputs: Sequence[Expr], names: Mapping[str, str] | None = None
) -> str:
    """Source of a C function (C99, <math.h>) that writes the outputs to ``double *out``.

    ``arguments`` are declarations.
    """
    lines, values = assignments(tape, {str(k): expr for k, expr in enumerate(outputs)}, C, names)
    body = [*lines, *(f"out[{k}] = {value};" for k, value in values.items())]
    head = f"void {name}({', '.join([*arguments, 'double *out'])})\n{{\n"
    return head + "".join(f"    {line}\n" for line in body) + "}\n"


def matlab_body(rows_of: str, tape: Tape, outputs: Sequence[Expr], names: Mapping[str, str] | None) -> str:
    """Lines of a MATLAB function that assign ``out``, a column per output, a row per row of the matrix ``rows_of``."""
    lines, values = assignments(tape, {str(k): expr for k, expr in enumerate(outputs)}, MATLAB, names)
    size = f"out = zeros(size({rows_of}, 1), {len(outputs)});"
    body = [*lines, size, *(f"out(:, {int(k) + 1}) = {value};" for k, value in values.items())]
    return "".join(f"{line}\n" for line in body) + "end\n"


def equations(tape: Tape, outputs: Mapping[str, Expr], names: Mapping[str, str] | None = None) -> str:
    """The outputs as lines of text for people, common parts first; ``names`` as of ``assignments``."""
    lines, values = assignments(tape, outputs, PYTHON, names)
    return "\n".join([*lines, *(f"{name} = {value}" for name, value in values.items())])
