"""From a case to recordings and a model file on disk, and what was hidden, at which size over the noise."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import minimum_filter1d

from arm_model.model_file import write_model
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from experiment import Experiment
from tests.blind.second.cases import Case, drawn
from tests.blind.second.effects import KINDS, Values
from tests.blind.second.laboratory import POSES, STIFF, Laboratory, arm_of, as_table, plant_of, servo_of
from tests.blind.second.motions import suite
from tests.blind.second.plant import Plant
from tests.blind.second.sensing import POINT_NOISE, TARGET, Sensing, changed, rows
from tests.blind.second.simulate import Motion, simulated
from tests.blind.second.stability import growing
from tests.blind.second.strangers import STRANGERS

HIDDEN, MODEL = "hidden.json", "model.toml"
ALL = {**KINDS, **STRANGERS}
CLOSE = 0.15
"""Of the size asked for."""
SHOWN = 2.0
"""Times the noise: what shows less is hidden elsewhere."""
ATTEMPTS = 5
AT_REST = {"limit_cycle", "mains_hum"}
AT_REVERSALS = {"presliding_friction", "stribeck_friction", "backlash"}
"""Effects that show where nothing moves, and where a joint turns round; others do while it moves."""
MOVING, AWAY = 0.02, 0.08
"""rad/s of a joint that moves, and s from any row in which it does not."""


@dataclass(frozen=True)
class Hidden:
    """One effect as it is: name, joint, parameters, and its size over the noise."""

    effect: str
    joint: int | None
    parameters: Values
    strength: float

    def table(self, where: Laboratory, growth: float) -> dict[str, object]:
        """As the scores take it; of what changes within a recording no one value is right."""
        values = {} if growth else dict(self.parameters)
        if self.effect == "joint_compliance" and where.sees_links:
            # beside the spring that the model has
            values["stiffness"] = 1.0 / (1.0 / values["stiffness"] - 1.0 / float(STIFF[(self.joint or 1) - 1]))
            values.pop("damping")
        return {"effect": self.effect, "joint": self.joint, "parameters": values, "strength": self.strength}


def generate(case: Case, folder: Path) -> tuple[Laboratory, list[dict[str, object]]]:
    """Writes model.toml, fit_K.mcap, held_out_K.mcap and hidden.json.

    Returns whose arm it is and the hidden effects with their strengths.
    """
    case, hidden = _shown(case)
    folder.mkdir(parents=True, exist_ok=True)
    where, fit_and_held = case.where, suite(case.where.motions, case.where.seed)
    arm = arm_of(where)
    write_model(folder / MODEL, arm)
    rig = _rig(where)
    for side, experiments in zip(("fit", "held_out"), fit_and_held):
        for number, experiment in enumerate(experiments):
            plant, sensing = _world(where, hidden, case.growth)
            for number_hidden, one in enumerate(hidden):
                if one.effect == "dropped_trigger" and number == 0:
                    row = round(one.parameters["place"] * 13.0 * where.rate)
                    sensing = changed(sensing, lost=(row, int(one.parameters["count"])))
                    hidden[number_hidden] = replace(one, parameters={**one.parameters, "row": float(row)})
            rng = np.random.default_rng([*case.key, number, len(side)])
            taken = rows(where, plant, sensing, simulated(where, plant, experiment), rng)
            times = taken.pop("t")
            write_table(folder / f"{side}_{number}.mcap", times, taken, Attachments(rig=rig))
    tables = [one.table(where, case.growth) for one in hidden]
    known = {"laboratory": as_table(where), "hidden": tables}
    (folder / HIDDEN).write_text(json.dumps(known, indent=1), encoding="utf-8")
    return where, tables


def _shown(case: Case) -> tuple[Case, list[Hidden]]:
    """The case and its effects at their sizes, in the first laboratory whose motions show all of them.

    Its servos are stable on them.
    """
    names = tuple(name for name, _ in case.effects)
    for attempt in range(ATTEMPTS):
        if attempt:
            case = drawn(case.kind, case.key[0], case.number, names, attempt)
        hidden = [_sized(case, number) for number in range(len(names))]
        if all(one.strength >= SHOWN * (1 - CLOSE) for one in hidden) and _steady(case, hidden):
            return case, hidden
    raise AssertionError(f"{case.name}: no laboratory of {ATTEMPTS} shows it, with servos that stay stable")


def _steady(case: Case, hidden: list[Hidden]) -> bool:
    """Whether the servos, which were tuned to the healthy arm, are stable on what is hidden, too."""
    servo = servo_of(case.where, plant_of(case.where, arm_of(case.where)))
    return all(growing(_world(case.where, hidden, case.growth)[0], servo, pose) is None for pose in POSES)


def _sized(case: Case, number: int) -> Hidden:
    """One effect of a case, by itself as strong as the case asks, as far as it may be."""
    effect, joint = case.effects[number]
    kind, goal = ALL[effect], case.sizes[number]
    experiments = tuple(suite(case.where.motions, case.where.seed)[1])
    healthy = plant_of(case.where, arm_of(case.where))._replace(growth=case.growth)

    def at(m: float) -> Hidden:
        rng = np.random.default_rng([*case.key, number, *map(ord, effect)])
        return Hidden(
            effect, joint, {name: float(x) for name, x in kind.draw(rng, healthy, joint or 1, m).items()}, 0.0
        )

    if kind.shown_by == "events":
        one = at(1.0)
        return replace(one, strength=abs(one.parameters.get("counts", one.parameters.get("count", 10.0))) + 1.0)
    m, below, above = 1.0, None, None
    for _ in range(9):
        one = at(m)
        reached = strength(case.where, one, case.growth, experiments)
        if abs(reached - goal) < CLOSE * goal or (reached < goal and m >= kind.most):
            break
        below, above = (m, above) if reached < goal else (below, m)
        m = min(m * float(np.clip(goal / max(reached, 1e-9), 0.1, 4.0)), kind.most)
        if below is not None and above is not None and not below < m < above:
            m = float(np.sqrt(below * above))
    return replace(one, strength=reached)


def strength(where: Laboratory, one: Hidden, growth: float, experiments: tuple[Experiment, ...]) -> float:
    """Change of what is recorded over its noise, rms over the rows in which the joint moves; the largest of the arm's.

    Two simulations without noise, with the effect and without. An effect that does not act at reversals is measured
    away from them: the slightest change of torque shifts the instant at which a joint breaks away, and with it a step
    of twice the friction, which says nothing about the effect.
    """
    plant, sensing = _world(where, [one], growth)
    power, count, points = np.zeros(6), np.zeros(6), 0.0
    for experiment in experiments:
        bare, motion = _bare(where, experiment.model_dump_json()), simulated(where, plant, experiment)
        plain = rows(where, plant_of(where, arm_of(where)), Sensing(), bare, None)
        other = rows(where, plant, sensing, motion, None)
        if ALL[one.effect].shown_by == "points":
            points += np.mean((other["xyz"] - plain["xyz"]) ** 2) / len(experiments)
            continue
        seen = np.ones_like(plain["i"], dtype=bool)
        if one.effect not in AT_REST:
            near = 1 if one.effect in AT_REVERSALS else round(2 * AWAY * where.rate) + 1
            speed = np.minimum(*(np.abs(np.gradient(taken["q"], taken["t"], axis=0)) for taken in (plain, other)))
            seen = minimum_filter1d(speed, near, axis=0) > MOVING
        power += np.sum(seen * (other["i"] - plain["i"]) ** 2, axis=0)
        count += np.sum(seen, axis=0)
    if ALL[one.effect].shown_by == "points":
        return float(np.sqrt(points) / POINT_NOISE)
    # of a joint that hardly moves nothing is judged
    ratio = np.where(count > 0.03 * where.rate * 10.0, np.sqrt(power / np.maximum(count, 1)) / where.noise, 0.0)
    return float(ratio.max() if one.joint is None else ratio[one.joint - 1])


@lru_cache(maxsize=8)
def _bare(where: Laboratory, experiment: str) -> Motion:
    return simulated(where, plant_of(where, arm_of(where)), Experiment.model_validate_json(experiment))


def _world(where: Laboratory, hidden: list[Hidden], growth: float) -> tuple[Plant, Sensing]:
    plant, sensing = plant_of(where, arm_of(where))._replace(growth=growth), Sensing()
    for one in hidden:
        plant, sensing = ALL[one.effect].apply(plant, sensing, one.joint or 1, one.parameters)
    return plant, sensing


def _rig(where: Laboratory) -> str:
    """A rig file as tables are imported with; the tracker's target stands in it."""
    lines = ['name = "arm"']
    if where.tracker:
        lines += ["[tracker]", f"target = {list(TARGET)}"]
    for number, joint in enumerate(arm_of(where).joints, 1):
        lines += ["[[joint]]", f'name = "joint{number}"', f"gear = {joint.gear}"]
    return "\n".join(lines) + "\n"


def cache_name(case: Case) -> str:
    """Changes with the case and with the generator."""
    text = "".join(path.read_text(encoding="utf-8") for path in sorted(Path(__file__).parent.glob("*.py")))
    return hashlib.sha256(f"{case!r} {text}".encode()).hexdigest()[:16]
