"""A simulated fleet: recordings of arms that wear, made by the batch engine, and the true values.

All nights of one kind of wear are lanes of one simulation. The recordings have the noise of the transducers and the
quantisation of the encoders. The true values include the change of current by wear, in units of that noise. If arms
have another temperature every night (``weather``), every arm and night is a lane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from arm_fleet.simulation.wear import Life, Wear
from arm_fleet.simulation.weather import friction_at, temperatures
from arm_io import InputError, make_folder, write_toml
from arm_io.json_text import write_json
from arm_io.progress import Progress, Step
from arm_io.types import Array
from arm_model import Arm, Motion, write_model
from arm_model.sensing import Readings, recorded
from arm_model.simulation import Demand, simulate_batch
from daq.recording import Attachments, write_table

NOISE = 0.01
"""A, noise std of every transducer."""
ENCODER = 1.5e-6
"""rad (m) per encoder step, at the joint."""
FREQUENCIES, SIZES = (0.17, 0.47, 1.3), (0.5, 0.28, 0.08)
"""Hz and rad of the sines of a motion."""
BEGUN = 1.5
"""s, duration of the smooth beginning of a motion."""
START = date(2026, 1, 1)
CLEAR = 3.0
"""Wear counts as visible if it changes the current by this multiple of the noise."""
LANES = 256
"""Maximum number of lanes per simulation; more need memory and save no time."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The recordings of every arm in every night: ``runs`` recordings of ``seconds`` at ``rate`` rows/s.

    correlation  s, correlation time of the noise of a transducer (to 1/e); 0: white noise
    temperature  K, std of an arm's temperature from night to night; season: K by which all arms are warmer in the
                 last night than in the first. If both are 0, all nights are alike, and no temperature is recorded
    """

    arm: Arm
    runs: int = 2
    seconds: float = 12.0
    rate: float = 250.0
    correlation: float = 0.0
    temperature: float = 0.0
    season: float = 0.0

    @property
    def changing(self) -> bool:
        """Whether the temperature varies from night to night."""
        return bool(self.temperature or self.season)

    @property
    def times(self) -> Array:
        """(rows,) s."""
        return np.arange(int(self.seconds * self.rate)) / self.rate

    def demand(self, run: int) -> Demand:
        """The motion of one recording: different in each recording of a night, the same in every night."""
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
    """Writes FOLDER/nights/NIGHT/ARM_RUN.mcap, model.toml, plan.toml and truth.json; returns the content of truth.json.

    InputError where they cannot be written, or the arm has no controller.
    """

    if scene.arm.controller is None:
        raise InputError(scene.arm.name, "has no [controller]; following demanded positions needs one")
    make_folder(folder)
    write_model(folder / "model.toml", scene.arm)
    model = (folder / "model.toml").read_text(encoding="utf-8")
    draw = np.random.default_rng([seed, 1])
    air = np.random.default_rng([seed, 2])
    temperature = temperatures(len(lives), nights, scene.temperature, air, season=scene.season)
    ratios = np.zeros((len(lives), nights))
    for run in range(scene.runs):
        for which, night, shown, ratio in _all(scene, run, lives, temperature):
            life = lives[which]
            ratios[which, night] = max(ratios[which, night], ratio)
            moment = datetime.combine(START + timedelta(days=night), datetime.min.time(), UTC) + timedelta(hours=22)
            path = folder / "nights" / night_of(night) / f"{life.arm}_{run + 1}.mcap"
            make_folder(path.parent)
            if scene.changing:
                shown["temp"] = np.full_like(shown["q"], temperature[which, night])
            _write(path, scene, shown, model, moment, draw)
            progress(Step("recordings", night + 1, nights, detail=f"{life.arm}, run {run + 1} of {scene.runs}"))
    truth = _truth(lives, nights, ratios)
    write_json(folder / "truth.json", truth, indent=1)
    write_toml(
        folder / "plan.toml", plan_table(lives), heading="The plan of a simulated fleet: armscope fleet plan.toml"
    )
    return truth


def night_of(number: int) -> str:
    """Date of a night (from 0): '2026-01-01' for the first."""
    return (START + timedelta(days=number)).isoformat()


def plan_table(lives: Sequence[Life]) -> dict[str, Any]:
    """The plan with which ``armscope fleet`` reads this fleet."""
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


Shown = dict[str, Array]
"""Signal -> (rows, J), without noise: q, i, qref."""


def _all(scene: Scene, run: int, lives: Sequence[Life], temperature: Array) -> Iterator[tuple[int, int, Shown, float]]:
    """Yields arm (index), night, signals, and change of current by wear, in units of the noise.

    temperature  (arms, nights) degC
    The change is relative to the same arm without wear at the same temperature: a gear with flexible teeth
    differs from a rigid gear even without a gap.
    """
    nights = temperature.shape[1]
    for wear in {life.wear: None for life in lives}:
        of_wear = [which for which, life in enumerate(lives) if life.wear == wear]
        values = np.array([lives[which].values(nights) for which in of_wear])
        places = np.argwhere(np.ones_like(values, bool))
        # Without wear all nights are alike then: one lane.
        still = None if scene.changing else _simulated(scene, run, wear, np.zeros(1), None)
        for first in range(0, len(places), LANES):
            some = places[first : first + LANES]
            degrees = temperature[of_wear][tuple(some.T)] if scene.changing else None
            some_values = values[tuple(some.T)]
            healthy = _simulated(scene, run, wear, 0 * some_values, degrees) if still is None else still
            worn = _simulated(scene, run, wear, some_values, degrees) if some_values.any() else healthy
            for lane, (which, night) in enumerate(some):
                before = healthy.lane(lane)
                shown = worn.lane(lane) if some_values[lane] else before
                change = shown["i"] - before["i"]
                yield of_wear[which], int(night), shown, float(np.sqrt(np.mean(change**2, axis=0)).max() / NOISE)


@dataclass(frozen=True)
class _Lanes:
    """Signals of several lanes."""

    readings: Readings
    demand: Array

    def lane(self, number: int) -> Shown:
        """Signals of one lane; if there is only one, the same for every number."""
        which = number % len(self.readings.q)
        return {"q": self.readings.q[which], "i": self.readings.current[which], "qref": self.demand}


def _simulated(scene: Scene, run: int, wear: Wear | None, values: Array, temperature: Array | None) -> _Lanes:
    """One lane per value of the parameter of a wear, and its temperature (lanes,) degC; None: that of the model."""
    arm = scene.arm
    varied: dict[str, Array] = {} if temperature is None else dict(friction_at(arm, temperature))
    if wear is not None:
        arm = replace(arm, effects=(*arm.effects, wear.term(float(values[0]))))
        varied[wear.quantity] = values
    motion = simulate_batch(arm, scene.demand(run), scene.times, parameters=varied or None)
    return _Lanes(_readings(arm, motion, wear, values), np.asarray(motion.demand))


def _readings(arm: Arm, motion: Motion, wear: Wear | None, values: Array) -> Readings:
    """Signals as the instruments read them; the instrument itself may wear."""
    if wear is None:
        return recorded(arm, motion)
    lanes = []
    for lane, value in enumerate(values):
        worn = replace(arm, effects=(*arm.effects[:-1], wear.term(float(value))))
        lanes.append(recorded(worn, _lane(motion, lane)))
    return Readings(np.stack([one.q for one in lanes]), np.stack([one.current for one in lanes]))


def _lane(motion: Motion, lane: int) -> Motion:
    fields = {
        name: values if values is None or values.ndim < 3 else values[lane] for name, values in vars(motion).items()
    }
    return Motion(**fields)


def _write(path: Path, scene: Scene, shown: Shown, model: str, moment: datetime, draw: np.random.Generator) -> None:
    made = {"kind": "simulated", "made": moment.isoformat()}
    current = shown["i"] + NOISE * _noise(shown["i"].shape, scene, draw)
    recorded = shown | {"q": np.round(shown["q"] / ENCODER) * ENCODER, "i": current}
    write_table(path, scene.times, recorded, Attachments(model=model, provenance=made))


def _noise(shape: tuple[int, ...], scene: Scene, draw: np.random.Generator) -> Array:
    """(rows, J) of variance 1: white, or of first order with the scene's correlation time."""
    white = draw.standard_normal(shape)
    if not scene.correlation:
        return white
    kept = float(np.exp(-1 / (scene.rate * scene.correlation)))
    # The state before the first row, so that it has the variance of all others.
    before = kept * draw.standard_normal((1, shape[1]))
    gain = np.sqrt(1 - kept**2)
    return np.asarray(signal.lfilter([gain], [1.0, -kept], white, axis=0, zi=before)[0])


def _truth(lives: Sequence[Life], nights: int, ratios: Array) -> dict[str, Any]:
    arms = []
    for life, ratio in zip(lives, ratios):
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
