"""Detection experiments: motions that make undetectable effects detectable, tried in simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model.effects import CATALOGUE, Excitation, Instrument
from diagnosis.cause import EffectKey, Undetectable
from diagnosis.experiments.discriminating import further, stage_of
from diagnosis.experiments.motions import Stage, Trial, of_joint, with_payload
from diagnosis.experiments.t_optimality import predicted_run
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_of
from diagnosis.measurements.currents.detectability import is_typical, signal_to_noise, times_noise
from diagnosis.result import Diagnosis
from diagnosis.selection.candidate import Candidate
from experiment import Experiment, demand_of
from identification.experiment_design import Limits

ENOUGH = 1.0
"""Effect-to-noise ratio that an effect of the largest typical size must reach: three times that of a detectable one."""
FAMILIES = {
    Excitation.LOAD: "in a slow sweep",
    Excitation.GRAVITY: "in a slow sweep",
    Excitation.LOAD_REVERSAL: "through the vertical",
    Excitation.CURRENT: "at 1 of its speed",
    Excitation.SPEED: "at 1 of its speed",
    Excitation.TEMPERATURE: "at 1 of its speed",
    Excitation.ACCELERATION: "at 1 of its speed",
    Excitation.MOTION: "in a slow sweep",
}
"""The family of motions (``motions``) that excites an effect most."""
OTHERWISE = "at 1 of its speed"
"""Family for a joint without such a motion: where gravity never changes sign, the load does with the acceleration."""
BESIDES = "an encoder at the link, or a tracker"


@dataclass(frozen=True)
class DetectionExperiment:
    """An undetectable effect with the description of its detection experiment; ``experiment``: the motion, if any."""

    undetectable: Undetectable
    experiment: Experiment | None = None


def detection_experiments(
    result: Diagnosis, rig: Limits | None = None, progress: Callable[[str], None] = lambda sentence: None
) -> list[DetectionExperiment]:
    """Detection experiments of all undetectable effects; the catalogue's sentence if no motion shows an effect."""
    if not result.judged:
        return [DetectionExperiment(one) for one in result.undetectable]
    stage = stage_of(result, [1], rig, visited=False)
    noise = np.mean([run.noise for run in result.fit], axis=0)
    wanted = {(one.effect, one.joint) for one in result.undetectable if one.joint is not None}
    alike: dict[tuple[int, str], list[Candidate]] = {}
    for c in candidates(result.arm):
        if c.joint is not None and c.key in wanted:
            alike.setdefault((c.joint, _family(c.effect)), []).append(c)
    places = list(alike)
    progress("detection experiments")
    tried = in_parallel(lambda at: list(_tried(stage, noise, *at, alike[at])), places)
    shown = {c.key: trials for at, trials in zip(places, tried) for c in alike[at]}
    return [
        DetectionExperiment(one) if (trials := shown.get((one.effect, one.joint))) is None else _best(one, trials)
        for one in result.undetectable
    ]


def _family(effect: str) -> str:
    """The family of motions that shows an effect."""
    return FAMILIES[CATALOGUE[effect].excited_by]


def _tried(
    stage: Stage, noise: Array, joint: int, family: str, effects: Sequence[Candidate]
) -> Iterator[tuple[Trial, dict[EffectKey, float]]]:
    """The motion of a joint of a family (or of OTHERWISE), with a known payload too if it does not show all.

    Each with the effect-to-noise ratios. It starts from the recorded pose whose load of the joint differs most.
    """
    trials = {trial.experiment.name: trial for trial in of_joint(stage, stage.poses[-1], joint)}
    trial = next((trials[name] for one in (family, OTHERWISE) if (name := f"joint {joint} {one}") in trials), None)
    if trial is None:
        return
    strengths = _strengths(trial, stage, noise, effects)
    yield trial, strengths
    if any(strengths.get(c.key, 0.0) < ENOUGH for c in effects):
        yield with_payload(trial), _strengths(with_payload(trial), stage, noise, effects)


def _strengths(trial: Trial, stage: Stage, noise: Array, effects: Sequence[Candidate]) -> dict[EffectKey, float]:
    """Effect-to-noise ratios of effects of the largest typical size in a simulated motion; empty if not feasible."""
    run = predicted_run(trial, stage, noise)
    if run is None:
        return {}
    side, strongest = dataset_of([run]), dict[EffectKey, float]()
    for c in effects:
        strength = signal_to_noise(c, columns_of(c, side), side.rows) if is_typical(c) else 0.0
        strongest[c.key] = max(strongest.get(c.key, 0.0), strength)
    return strongest


def _best(one: Undetectable, tried: Sequence[tuple[Trial, dict[EffectKey, float]]]) -> DetectionExperiment:
    key = one.effect, one.joint
    for trial, strengths in tried:
        if strengths.get(key, 0.0) >= ENOUGH:
            words = (
                f"{trial.words} ({demand_of(trial.experiment).duration:.0f} s in all): {times_noise(strengths[key])}"
            )
            experiment = trial.experiment.model_copy(update={"description": further(trial.words)})
            return DetectionExperiment(replace(one, experiment=words), experiment)
    able = [(trial, strengths[key]) for trial, strengths in tried if key in strengths]
    if not able:
        return DetectionExperiment(one)
    # the first of trials with the same printed distance: smaller differences are rounding
    trial, largest = max(able, key=lambda pair: round(pair[1], 2))
    motion = trial.words.removeprefix(f"joint {one.joint} ")
    words = f"none of the motions tried for this joint suffices ({motion}: {times_noise(largest)})"
    effect = CATALOGUE[one.effect]
    # the catalogue names instruments that show effects of gravity without a motion
    by_links = Instrument.LINK_ENCODER in effect.observed_by and effect.excited_by is not Excitation.GRAVITY
    besides = BESIDES if by_links else one.experiment
    return DetectionExperiment(replace(one, experiment=f"{words}; {besides}"))
