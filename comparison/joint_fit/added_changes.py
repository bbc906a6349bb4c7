"""Changes of effects beyond the model as quantities: amplitude and phase of a ripple, stiffness, compliance, gap."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import solved
from comparison.change import Change, Quantity
from comparison.joint_fit.effects import Added
from comparison.joint_fit.hypotheses import Hypothesis, chance
from comparison.joint_fit.tested import Tested
from comparison.regression import Structure

KNOWN = 4.0
"""Deviations from zero that the amplitudes of both sides must have for their phases to be compared."""
SIGNIFICANT_STDS = 2.0
"""Deviations by which amplitude, or phase, must differ to be what changed."""


def added_changes(
    structure: Structure,
    every: Sequence[Hypothesis],
    found: Sequence[Tested],
    values: Array,
    covariance: Array,
) -> list[Change]:
    """One or two per effect and joint, by the alternative that explains most.

    Of an effect beyond the model that did not enter, the size on either side is no quantity: its column takes what
    the model lacks otherwise.

    found   the hypotheses that entered
    values, covariance  (c,), (c, c) of the side before
    """
    parts = (
        _changes(structure.arm, one, chance(one.log_p, every), values, covariance) for one in _best(found).values()
    )
    return [change for part in parts for change in part]


def _best(tested: Sequence[Tested]) -> dict[tuple[str, int | None, float], Tested]:
    """Per effect, joint and order, that of effects beyond the model which explains most."""
    best: dict[tuple[str, int | None, float], Tested] = {}
    for one in tested:
        if one.hypothesis.added is not None:
            added = _added(one)
            key = added.effect, added.joint, added.held.get("order", 0.0)
            if key not in best or one.gain > best[key].gain:
                best[key] = one
    return best


def _added(one: Tested) -> Added:
    assert one.hypothesis.added is not None
    return one.hypothesis.added


def _changes(arm: Arm, one: Tested, log_corrected: float, values: Array, covariance: Array) -> Iterator[Change]:
    added, places = _added(one), one.hypothesis.directions.T
    then, spread = places @ values, places @ covariance @ places.T
    by, along = places @ one.changes, places @ one.directions
    changed = along @ one.covariance @ along.T
    judged = float(np.exp(one.log_p)), min(1.0, float(np.exp(log_corrected)))
    if added.placed or added.timed:
        yield from _of_place(arm, added, by, changed, judged)
        return
    if not added.wave:
        quantity, size = _of_size(arm, added)
        stds = size * np.sqrt(np.maximum([spread[0, 0], changed[0, 0]], 0.0))
        yield _change(quantity, size * float(then[0]), size * float(by[0]), stds, judged)
        return
    yield from _of_wave(arm, added, (then, spread), (by, changed), judged)


def _of_place(arm: Arm, added: Added, by: Array, spread: Array, judged: tuple[float, float]) -> Iterator[Change]:
    """Changes of the base's tilt, of an encoder's zero or of the delay, from their unknown values before.

    A parameter that clearly changed gets the p-values ``judged`` of the whole hypothesis, the others get 1.
    """
    stds = np.sqrt(np.maximum(np.diag(spread), 0.0))
    clear = np.abs(by) > SIGNIFICANT_STDS * stds
    clear[int(np.argmax(np.abs(by) / np.maximum(stds, 1e-300)))] = True
    if added.timed:
        quantity = _quantity(added, "delay", "change of the delay of the currents relative to the angles", "s")
        yield _change(quantity, 0.0, float(by[0]), np.array([0.0, stds[0]]), judged)
        return
    unit = "rad" if added.joint is None or arm.joints[added.joint - 1].revolute else "m"
    for k, parameter in enumerate(added.definition.parameters):
        words = (
            f"{parameter.name} of the base" if added.joint is None else f"zero of the encoder of joint {added.joint}"
        )
        quantity = _quantity(added, parameter.name, f"change of the {words}", unit)
        yield _change(quantity, 0.0, float(by[k]), np.array([0.0, stds[k]]), judged if clear[k] else (1.0, 1.0))


def _of_size(arm: Arm, added: Added) -> tuple[Quantity, float]:
    """The quantity of a spring, an elastic gear or a gap, and its value per unit of the coefficient."""
    assert added.joint is not None
    revolute, n = arm.joints[added.joint - 1].revolute, added.joint
    if added.effect == "gravity_spring":
        words, name, unit, size = f"stiffness of a spring at joint {n}", "stiffness", ("N m/rad", "N/m"), 1.0
    elif added.effect == "joint_compliance":
        words, name, unit = f"compliance of the gear of joint {n}", "compliance", ("rad/(N m)", "m/N")
        size = 1.0 / added.held["stiffness"]
    else:
        words, name, unit, size = f"half gap of joint {n}", "half_gap", ("rad", "m"), added.held["half_gap"]
    return _quantity(added, name, words, unit[0] if revolute else unit[1]), size


def _of_wave(
    arm: Arm, added: Added, before: tuple[Array, Array], by: tuple[Array, Array], judged: tuple[float, float]
) -> Iterator[Change]:
    """Amplitude and phase of a ripple: that which changed carries the chance of both."""
    assert added.joint is not None
    joint = arm.joints[added.joint - 1]
    torque = bool(added.amplitude)
    name = added.amplitude or added.definition.linear[0].name
    unit = ("N m" if joint.revolute else "N") if torque else ("rad" if joint.revolute else "m")
    cycles = added.held["order"] * joint.ratio
    turn = f"{cycles:.4g} cycles per turn" if joint.revolute else f"{cycles / (2 * np.pi):.4g} cycles per m"
    words = f"{'torque' if torque else 'angle'} ripple of joint {added.joint}, {turn}"
    then, now = before[0], before[0] + by[0]
    sizes = [float(np.hypot(*one)) for one in (then, now)]
    spread = before[1], before[1] + by[1]
    stds = [_along(one, of) for one, of in zip((then, now), spread)]
    change_std = _along(now if sizes[1] > sizes[0] else then, by[1])
    amplitudes_known = all(size > KNOWN * std for size, std in zip(sizes, stds))
    phases = [solved(added.definition, added.held, one.tolist(), added.amplitude)["phase"] for one in (then, now)]
    turned = float(np.angle(np.exp(1j * (phases[1] - phases[0]))))
    phase_std = math.hypot(*(std / max(size, 1e-300) for std, size in zip(stds, sizes)))
    by_phase = amplitudes_known and abs(turned) > SIGNIFICANT_STDS * phase_std
    by_size = not by_phase or abs(sizes[1] - sizes[0]) > SIGNIFICANT_STDS * change_std
    entry = f"{name}({cycles:.4g})"
    yield _change(
        _quantity(added, f"{entry}.amplitude", words, unit),
        sizes[0],
        sizes[1] - sizes[0],
        np.array([stds[0], change_std]),
        judged if by_size else (1.0, 1.0),
    )
    yield _change(
        _quantity(added, f"{entry}.phase", f"phase of the {words}", "rad"),
        phases[0],
        turned,
        np.array([stds[0] / max(sizes[0], 1e-300), phase_std]),
        judged if by_phase else (1.0, 1.0),
    )


def _along(vector: Array, covariance: Array) -> float:
    """Std of the length of a vector (2,) with a covariance (2, 2)."""
    size = float(np.hypot(*vector))
    unit = vector / size if size > 0.0 else np.array([1.0, 0.0])
    return math.sqrt(max(float(unit @ covariance @ unit), 0.0))


def _quantity(added: Added, entry: str, words: str, unit: str) -> Quantity:
    place = "" if added.joint is None else f"joint{added.joint}."
    name = f"{place}{added.effect}.{entry}"
    return Quantity(name=name, words=words, unit=unit, kind="effect", joint=added.joint)


def _change(quantity: Quantity, before: float, by: float, stds: Array, judged: tuple[float, float]) -> Change:
    return Change(
        quantity=quantity,
        before=before,
        after=before + by,
        std_before=float(stds[0]),
        std_after=float(np.hypot(*stds)),
        std=float(stds[1]),
        p=judged[0],
        corrected=judged[1],
    )
