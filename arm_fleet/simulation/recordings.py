"""A simulated fleet: recordings of arms that wear, made by the batch engine, with the truth beside them.

All nights of one kind of wear are lanes of one simulation. What is recorded has the noise of the transducers and the
steps of the encoders; the truth says by how much wear changes the current, in units of that noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from arm_fleet.simulation.wear import Life, Wear
from arm_io import InputError, make_folder, whole_file, write_toml
from arm_io.progress import Progress, Step
from arm_io.types import Array
from arm_model import Arm, Motion, write_model
from arm_model.sensing import Readings, recorded
from arm_model.simulation import Demand, simulate_batch
from daq.recording import Attachments, write_table

NOISE = 0.01
"""A, white, of every transducer."""
ENCODER = 1.5e-6
"""rad (m) of one step, at the joint."""
FREQUENCIES, SIZES = (0.17, 0.47, 1.3), (0.5, 0.28, 0.08)
"""Hz and rad of the sines of a motion."""
BEGUN = 1.5
"""s over which a motion begins."""
START = date(2026, 1, 1)
CLEAR = 3.0
"""Times the noise: when wear is called visible."""
LANES = 256
"""Of one simulation: more take memory and gain nothing."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What every arm does every night: ``runs`` recordings of ``seconds`` at ``rate`` rows/s."""

    arm: Arm
    runs: int = 2
    seconds: float = 12.0
    rate: float = 250.0

    @property
    def times(self) -> Array:
        """(rows,) s."""
        return np.arange(int(self.seconds * self.rate)) / self.rate

    def demand(self, run: int) -> Demand:
        """The motion of one of the recordings: another one in each, the same every night."""
        joints = len(self.arm)
        phase = np.random.default_rng(run).uniform(0, 2 * np.pi, (joints, len(SIZES)))

        def positions(t: Array) -> Array:
            begun = np.clip(t / BEGUN, 0.0, 1.0)
            begun = begun**3 * (10 - 15 * begun + 6 * begun**2)
            turns = 2 * np.pi * np.multiply.outer(t, np.array(FREQUENCIES))
            waves = [np.sin(turns * (1 + 0.1 * j) + phase[j]) @ np.array(SIZES) for j in range(joints)]
            return np.asarray(begun[:, None] * np.stack(waves, axis=1) + 0.3 * np.arange(1, joints + 1))

        return positions


def write_fleet(
    folder: Path, scene: Scene, lives: Sequence[Life], nights: int, *, seed: int, progress: Progress = lambda _: None
) -> dict[str, Any]:
    """Writes FOLDER/nights/NIGHT/ARM_RUN.mcap, model.toml, plan.toml and truth.json; returns what truth.json says.

    InputError where they cannot be written, or the arm has no controller.
    """
    import json

    if scene.arm.controller is None:
        raise InputError(scene.arm.name, "has no [controller]; following demanded positions needs one")
    make_folder(folder)
    write_model(folder / "model.toml", scene.arm)
    model = (folder / "model.toml").read_text(encoding="utf-8")
    draw = np.random.default_rng([seed, 1])
    ratios: dict[str, Array] = {life.arm: np.zeros(nights) for life in lives}
    for run in range(scene.runs):
        healthy = _simulated(scene, run, None, np.zeros(1))
        for life, night, shown, ratio in _all(scene, run, lives, nights, healthy):
            ratios[life.arm][night] = max(ratios[life.arm][night], ratio)
            moment = datetime.combine(START + timedelta(days=night), datetime.min.time(), UTC) + timedelta(hours=22)
            path = folder / "nights" / night_of(night) / f"{life.arm}_{run + 1}.mcap"
            make_folder(path.parent)
            _write(path, scene, shown, model, moment, draw)
            progress(Step("recordings", night + 1, nights, detail=f"{life.arm}, run {run + 1} of {scene.runs}"))
    truth = _truth(lives, nights, ratios)
    with whole_file(folder / "truth.json") as file:
        file.write(json.dumps(truth, indent=1) + "\n")
    write_toml(
        folder / "plan.toml", plan_table(lives), heading="The plan of a simulated fleet: armscope fleet plan.toml"
    )
    return truth


def night_of(number: int) -> str:
    """'2026-01-01' of the first night (from 0)."""
    return (START + timedelta(days=number)).isoformat()


def plan_table(lives: Sequence[Life]) -> dict[str, Any]:
    """The plan that reads such a fleet."""
    return {
        "name": "simulated fleet",
        "model": "model.toml",
        "recordings": "nights/{night}/{arm}_*.mcap",
        "run": ["identify", "diagnose"],
        "baseline": [night_of(0), night_of(4)],
        "timeout": 600.0,
        "memory": 2.0,
        "arm": [{"name": life.arm} for life in lives],
    }


def _all(
    scene: Scene, run: int, lives: Sequence[Life], nights: int, healthy: tuple[Motion, Readings, Demand]
) -> Iterator[tuple[Life, int, tuple[Array, Array, Array], float]]:
    """Arm, night, its (rows, J) angles, currents and demands without noise, and change of current over the noise.

    The change is against the same arm before it wears: a gear whose teeth are flexible differs from a rigid one
    without any gap.
    """
    for wear in {life.wear: None for life in lives}:
        mine = [life for life in lives if life.wear == wear]
        motion, readings, _ = healthy if wear is None else _simulated(scene, run, wear, np.zeros(1))
        still = readings.q[0], readings.current[0], motion.demand
        if wear is None:
            yield from ((life, night, still, 0.0) for life in mine for night in range(nights))
            continue
        values = np.array([life.values(nights) for life in mine])
        for life, own in zip(mine, values):
            yield from ((life, int(night), still, 0.0) for night in np.flatnonzero(own == 0))
        places = np.argwhere(values != 0)
        for first in range(0, len(places), LANES):
            some = places[first : first + LANES]
            worn, shown, _ = _simulated(scene, run, wear, values[tuple(some.T)])
            for lane, (which, night) in enumerate(some):
                change = shown.current[lane] - still[1]
                ratio = float(np.sqrt(np.mean(change**2, axis=0)).max() / NOISE)
                yield mine[which], int(night), (shown.q[lane], shown.current[lane], worn.demand), ratio


def _simulated(scene: Scene, run: int, wear: Wear | None, values: Array) -> tuple[Motion, Readings, Demand]:
    """One lane per value of the parameter of a wear."""
    arm, demand = scene.arm, scene.demand(run)
    varied: Mapping[str, Array] | None = None
    if wear is not None:
        arm = replace(arm, effects=(*arm.effects, wear.term(float(values[0]))))
        varied = {wear.quantity: values}
    motion = simulate_batch(arm, demand, scene.times, parameters=varied)
    return motion, _readings(arm, motion, wear, values), demand


def _readings(arm: Arm, motion: Motion, wear: Wear | None, values: Array) -> Readings:
    """What the instruments show, which may be what wears."""
    if wear is None:
        return recorded(arm, motion)
    lanes = []
    for lane, value in enumerate(values):
        mine = replace(arm, effects=(*arm.effects[:-1], wear.term(float(value))))
        lanes.append(recorded(mine, _lane(motion, lane)))
    return Readings(np.stack([one.q for one in lanes]), np.stack([one.current for one in lanes]))


def _lane(motion: Motion, lane: int) -> Motion:
    fields = {
        name: values if values is None or values.ndim < 3 else values[lane] for name, values in vars(motion).items()
    }
    return Motion(**fields)


def _write(
    path: Path,
    scene: Scene,
    shown: tuple[Array, Array, Array],
    model: str,
    moment: datetime,
    draw: np.random.Generator,
) -> None:
    q, current, demand = shown
    write_table(
        path,
        scene.times,
        {
            "q": np.round(q / ENCODER) * ENCODER,
            "i": current + NOISE * draw.standard_normal(current.shape),
            "qref": demand,
        },
        Attachments(model=model, provenance={"kind": "simulated", "made": moment.isoformat()}),
    )


def _truth(lives: Sequence[Life], nights: int, ratios: Mapping[str, Array]) -> dict[str, Any]:
    arms = []
    for life in lives:
        ratio = ratios[life.arm]
        clear = np.flatnonzero(ratio >= CLEAR)
        arms.append(
            {
                "arm": life.arm,
                "wear": None if life.wear is None else life.wear.name,
                "effect": None if life.wear is None else life.wear.effect,
                "joint": None if life.wear is None else life.wear.joint,
                "quantity": None if life.wear is None else life.wear.quantity,
                "begins": None if life.wear is None else night_of(life.begins + 1),
                "visible": night_of(int(clear[0])) if len(clear) else None,
                "repaired": None if life.repaired is None else night_of(life.repaired),
                "values": life.values(nights).tolist(),
                "ratios": ratio.tolist(),
            }
        )
    return {
        "schema": "armscope.fleet.truth/1",
        "nights": [night_of(number) for number in range(nights)],
        "noise": NOISE,
        "arms": arms,
    }
