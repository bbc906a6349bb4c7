"""Whether the friction of a joint depends on its load and its temperature, decided on held-out rows.

Tried beside the shape over speed (``identification.methods.free_friction``), at every joint whose load, or whose
recorded temperature, varies enough to show it. A dependence stays where it reduces the held-out error as a curve must,
and where its coefficients are clearly not zero; what could not be tried, and why, is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from identification.methods.friction_trial import trials_of
from identification.methods.held_out import cross_validated, held_out_residuals
from identification.methods.solution import Solution, fitted_arm, friction_sizes, solve
from identification.preprocessing.signals import Motion
from identification.regression.conditional_friction import (
    LOAD,
    TEMPERATURE,
    Conditions,
    conditions_of,
    terms_for,
    with_terms,
)
from identification.regression.effect_columns import name_of
from identification.regression.least_squares import Method

SIGNIFICANT_STDS = 3.0
"""Deviations from zero of a coefficient that stays."""
TYPICAL_SHARE = 0.05
"""Of the transmitted torque: load friction that a motion must be able to show."""
DETECTABLE = 0.01
"""Of a joint's friction: rms change by TYPICAL_SHARE that shows."""
WARMING = 3.0
"""K between the coldest and the warmest of the fitted rows, at least."""


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Friction of a joint (from 1) over its load or its temperature: whether it ``stays`` in the model, and ``why``.

    parameters: name of the coefficient -> value, std (of those that stay); held: the other parameters of these effects;
    temperature: degC at which the rest of the joint's friction holds.
    """

    joint: int
    on: str
    stays: bool
    why: str
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    temperature: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As identification.json has it."""
        table: dict[str, Any] = {"joint": self.joint, "on": self.on, "stays": self.stays, "why": self.why}
        if self.temperature is not None:
            table["temperature"] = self.temperature
        sizes = {name: {"value": value, "std": std} for name, (value, std) in self.parameters.items()}
        return table | {"parameters": sizes, "held": dict(self.held)}


@dataclass
class _Tried:
    """What is tried at the joints (from 0): effects, references degC, lowest speeds; and what cannot be, and why."""

    terms: list[EffectTerm] = field(default_factory=list)
    references: dict[int, float] = field(default_factory=dict)
    slowest: dict[int, float] = field(default_factory=dict)
    refused: list[Dependence] = field(default_factory=list)


def with_load_and_temperature(found: Solution, method: Method, progress: Progress) -> tuple[Solution, list[Dependence]]:
    """The fit with friction over load and temperature, where held-out rows justify it.

    Effects of this kind that the model already has are kept and fitted.
    """
    progress("friction over load and temperature")
    near = fitted_arm(found)
    tried = _tried(found, near)
    if not tried.terms:
        return found, tried.refused
    wider = solve(with_terms(found.problem, near, tried.terms, tried.references), method, progress)
    stay, why = _justified(found, wider, tried)
    if stay:
        warm = {term.joint - 1 for term in stay if term.joint and term.name in TEMPERATURE}
        references = {j: degc for j, degc in tried.references.items() if j in warm}
        wider = solve(with_terms(found.problem, near, stay, references), method, progress)
    judged = [*tried.refused, *(_dependence(wider, tried, stay, j, on, why[j]) for j, on in _kinds(tried.terms))]
    return (wider if stay else found), sorted(judged, key=lambda one: (one.joint, one.on))


def _kinds(terms: Sequence[EffectTerm]) -> list[tuple[int, str]]:
    """Joints (from 0) and what their friction was tried over, each once."""
    return list(dict.fromkeys(((term.joint or 1) - 1, _on(term)) for term in terms))


def _on(term: EffectTerm) -> str:
    return "load" if term.name in LOAD else "temperature"


def _tried(found: Solution, arm: Arm) -> _Tried:
    problem, tried = found.problem, _Tried()
    sizes, residual = friction_sizes(problem, found.best), found.residual(problem.rows)
    present = {(term.joint, term.name) for term in problem.arm.effects}
    for j in range(len(arm)):
        certain = [motion.certain[:, j] for motion in problem.motions]
        if not any(motion.moves(j) and rows.any() for motion, rows in zip(problem.motions, certain)):
            continue
        reference = _reference(problem.motions, j)
        seen, names = conditions_of(arm, problem.motions, j, reference), list[str]()
        load = np.concatenate([np.abs(one.load[rows]) for one, rows in zip(seen, certain)])
        if not any((j + 1, name) in present for name in LOAD):
            if TYPICAL_SHARE * load.std() < DETECTABLE * sizes[j]:
                unit = "N m" if arm.joints[j].revolute else "N"
                why = f"its load varies by {load.std():.2g} {unit} (std) while it slides, which shows no dependence"
                tried.refused.append(Dependence(joint=j + 1, on="load", stays=False, why=why))
            else:
                names += LOAD
        if (j + 1, TEMPERATURE[0]) not in present and reference is not None:
            why = _no_temperature([*problem.motions, *problem.held_motions], seen, certain, j)
            if why:
                tried.refused.append(Dependence(joint=j + 1, on="temperature", stays=False, why=why))
            else:
                names += TEMPERATURE
                tried.references[j] = reference
        v = np.concatenate([np.abs(motion.qd[rows, j]) for motion, rows in zip(problem.motions, certain)])
        tried.slowest[j] = float(np.quantile(v, 0.01))
        if names:
            tried.terms += terms_for(problem, residual, seen, names, (tried.slowest[j], float(v.max())))
    return tried


def _reference(motions: Sequence[Motion], j: int) -> float | None:
    """degC, mean of motor j (from 0) in the motions that have it, to a tenth; None where none has."""
    courses = [None if m.temperatures is None else m.temperatures.at(j, m.t[m.certain[:, j]]) for m in motions]
    known = [one for one in courses if one is not None and len(one)]
    return round(float(np.mean(np.concatenate(known))), 1) if known else None


def _no_temperature(motions: Sequence[Motion], seen: Sequence[Conditions], certain: Sequence[Any], j: int) -> str:
    """Why the temperature of joint j (from 0) shows nothing; "" where it does."""
    if any(motion.temperatures is None or not motion.temperatures.degc[j] for motion in motions):
        return "not every recording has its temperature"
    warm = np.concatenate([one.warmer[rows] for one, rows in zip(seen, certain) if one.warmer is not None])
    if np.ptp(warm) < WARMING:
        return f"its temperature varies by {np.ptp(warm):.1f} K, and less than {WARMING:g} K shows no dependence"
    return ""


def _justified(found: Solution, wider: Solution, tried: _Tried) -> tuple[list[EffectTerm], dict[int, str]]:
    """The effects that stay, with those coefficients alone that are clearly not zero, and per joint the reason."""
    values, joints = _estimates(wider), sorted({j for j, _ in _kinds(tried.terms)})
    residuals = held_out_residuals(found, wider), cross_validated(found, wider)
    slowest = {j: tried.slowest[j] for j in joints}
    stay: list[EffectTerm] = []
    why: dict[int, str] = {}
    for j, trial in zip(joints, trials_of(*residuals, slowest, friction_sizes(found.problem, found.best))):
        unit = "N m" if found.problem.arm.joints[j].revolute else "N"
        why[j] = trial.compared(unit)
        if not trial.stays:
            continue
        for term in tried.terms:
            if term.joint != j + 1:
                continue
            searched = {p.name for p in CATALOGUE[term.name].nonlinear}
            clear = {name: value for name, value in term.parameters.items() if name in searched}
            clear |= {name: 0.0 for name in term.parameters if _is_clear(term, name, values)}
            if len(clear) > len(searched):
                stay.append(replace(term, parameters=clear))
    return stay, why


def _is_clear(term: EffectTerm, name: str, known: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a coefficient was identified, is clearly not zero, and can have its sign."""
    value, std = known.get(name_of(term, name), (0.0, 1.0))
    return abs(value) > SIGNIFICANT_STDS * std and CATALOGUE[term.name].admits(name, value)


def _estimates(fit: Solution) -> dict[str, tuple[float, float]]:
    """Value and std of the fitted base parameters by name."""
    names = [fit.problem.base.names[k] for k in fit.problem.columns]
    std: Array = fit.uncertainty.std
    return {name: (float(v), float(s)) for name, v, s in zip(names, fit.best.values, std)}


def _dependence(fit: Solution, tried: _Tried, stay: Sequence[EffectTerm], j: int, on: str, why: str) -> Dependence:
    terms = [term for term in stay if term.joint == j + 1 and _on(term) == on]
    values = _estimates(fit)
    stated = {name_of(term, name): value for term in terms for name, value in term.parameters.items()}
    return Dependence(
        joint=j + 1,
        on=on,
        stays=bool(terms),
        why=why,
        parameters={name.split(".", 1)[1]: values[name] for name in stated if name in values},
        held={name.split(".", 1)[1]: value for name, value in stated.items() if name not in values},
        temperature=tried.references.get(j) if on == "temperature" else None,
    )
