"""The four classical parameterisations of a serial arm, each as a chain of elementary transforms.

Denavit-Hartenberg    Rz(theta + q) Tz(d + q) Tx(a) Rx(alpha)              Denavit and Hartenberg, J. Appl. Mech. 22,
                      1955
Hayati                ... Ry(beta) last; d fixed where axes are parallel   Hayati and Mirmirani, J. Robotic Systems
                      2(4), 1985
Whitney-Lozinski      six numbers a link, three translations and three     Whitney, Lozinski and Rourke, J. Dyn. Sys.
                      Meas.
                      rotations: Rz(q) Tx Ty Tz Rz Ry Rx                   Control 108(1), 1986
S-model               Rz(beta + q) Tz(d + q) Tx(a) Rx(alpha) Rz(gamma) Tz(b)  Stone, "Kinematic Modeling,
                      Identification, and
                                                                           Control of Robotic Manipulators", Kluwer 1987

Joint coordinates q are about (revolute) or along (prismatic) z of the frame before the link. Tables are arrays with one
row per joint; ``prismatic`` says which joints translate. Angles rad, lengths m. ``base`` (4, 4) is the frame of joint 1
in the world, ``tool`` (4, 4) the end frame in the frame of the last link.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from arm_io.types import Array
from identification.kinematics.models.chain import Chain, Motion, Step, placement

HAYATI = ("theta", "d", "a", "alpha", "beta")
WHITNEY_LOZINSKI = ("x", "y", "z", "yaw", "pitch", "roll")
S_MODEL = ("beta", "d", "a", "alpha", "gamma", "b")


def denavit_hartenberg(table: ArrayLike, *, base: ArrayLike, tool: ArrayLike, prismatic: Sequence[bool]) -> Chain:
    """Standard D-H chain; ``table`` (joints, 4): theta, d, a, alpha."""
    table = _table(table, 4, prismatic)
    return hayati(np.column_stack((table, np.zeros(len(table)))), base=base, tool=tool, prismatic=prismatic)


def hayati(table: ArrayLike, *, base: ArrayLike, tool: ArrayLike, prismatic: Sequence[bool]) -> Chain:
    """D-H with Hayati's rotation about y last; ``table`` (joints, 5): theta, d, a, alpha, beta."""
    steps = [step for j, row in enumerate(_table(table, 5, prismatic)) for step in hayati_link(j, row, prismatic[j])]
    return _between(base, steps, tool)


def hayati_link(joint: int, row: ArrayLike, prismatic: bool) -> list[Step]:
    """The five steps of one link; ``joint`` 0-based, ``row`` theta, d, a, alpha, beta; parameters joint{j}.theta ..."""
    theta, d, a, alpha, beta = (float(v) for v in np.asarray(row, float))
    name = f"joint{joint + 1}."
    return [
        Step("rz", theta, name + "theta", None if prismatic else joint),
        Step("tz", d, name + "d", joint if prismatic else None),
        Step("tx", a, name + "a"),
        Step("rx", alpha, name + "alpha"),
        Step("ry", beta, name + "beta"),
    ]


def whitney_lozinski(table: ArrayLike, *, base: ArrayLike, tool: ArrayLike, prismatic: Sequence[bool]) -> Chain:
    """Six-parameter links.

    ``table`` (joints, 6): x, y, z, yaw, pitch, roll of the next frame after the joint's motion.
    """
    motions: tuple[Motion, ...] = ("tx", "ty", "tz", "rz", "ry", "rx")
    steps = []
    for j, row in enumerate(_table(table, 6, prismatic)):
        steps.append(Step("tz" if prismatic[j] else "rz", 0.0, f"joint{j + 1}.q", j))
        steps += [
            Step(m, float(v), f"joint{j + 1}.{n}") for m, v, n in zip(motions, row, WHITNEY_LOZINSKI, strict=True)
        ]
    return _between(base, steps, tool)


def s_model(table: ArrayLike, *, base: ArrayLike, tool: ArrayLike, prismatic: Sequence[bool]) -> Chain:
    """Stone's S-model; ``table`` (joints, 6): beta, d, a, alpha, gamma, b."""
    motions: tuple[Motion, ...] = ("rz", "tz", "tx", "rx", "rz", "tz")
    steps = []
    for j, row in enumerate(_table(table, 6, prismatic)):
        moving = 1 if prismatic[j] else 0
        for k, (motion, value, name) in enumerate(zip(motions, row, S_MODEL, strict=True)):
            steps.append(Step(motion, float(value), f"joint{j + 1}.{name}", j if k == moving else None))
    return _between(base, steps, tool)


def _between(base: ArrayLike, steps: list[Step], tool: ArrayLike) -> Chain:
    return Chain((*placement("base", base), *steps, *placement("tool", tool)))


def _table(table: ArrayLike, columns: int, prismatic: Sequence[bool]) -> Array:
    table = np.asarray(table, float)
    if table.shape != (len(prismatic), columns):
        raise ValueError(f"the table must be ({len(prismatic)}, {columns}), is {table.shape}")
    return table
