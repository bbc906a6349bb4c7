"""Discriminating experiments: the motion that isolates the members of an ambiguity group, chosen among many.

The best motion has the largest smallest distance between the predictions of the rivals (``t_optimality``), among the
families of ``motions`` within the recorded positions. A motion alone is preferred; then the drives off; then a known
payload; then a motion that exceeds the recorded positions. Where none discriminates, the catalogue names another
experiment, such as a reference shunt.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.progress import Progress, Step
from arm_model.effects import CATALOGUE
from arm_model.rigid_body import drive_rigid_torque
from diagnosis.cause import Cause, EffectKey, Signal, in_words
from diagnosis.experiments.motions import Kind, Stage, Trial, room, trials
from diagnosis.experiments.t_optimality import Question, predicted_run, rival_of
from diagnosis.measurements.currents.columns import candidates
from diagnosis.result import Diagnosis
from diagnosis.selection.candidate import Candidate
from experiment import Experiment, demand_of
from identification.experiment_design import Limits

Distances = dict[tuple[EffectKey, EffectKey], float]

ENOUGH = 10.0
"""Std of the noise by which predictions must differ: errors of the model reduce the distance in a real motion."""

NOTHING = 0.1
"""Std below which predictions are equal."""
ONE_IN = 3
"""Of this number of motions of a kind one is tried first; if predictions are equal in all of these, the others are
not tried."""

HOPELESS = 3.0
"""Std below which motions that exceed the recorded positions are not tried."""


@dataclass(frozen=True)
class Separation:
    """A discriminating experiment.

    experiment  to be recorded; None: no motion discriminates
    distance    std of the noise by which predictions differ at least
    words       description of the motion
    tried       number of motions that it was chosen from
    """

    experiment: Experiment | None
    distance: float
    words: str
    tried: int


def separations(
    result: Diagnosis, rig: Limits | None = None, progress: Progress = lambda sentence: None
) -> dict[int, Separation]:
    """The discriminating experiment of every cause (by index, from 0) with an ambiguity group."""
    return {
        place: separation(cause, result, rig, progress)
        for place, cause in enumerate(result.causes)
        if len(cause.group) > 1
    }


def separation(
    cause: Cause, result: Diagnosis, rig: Limits | None = None, progress: Progress = lambda sentence: None
) -> Separation:
    """The experiment for the ambiguity group of a cause; ``rig``: limits in addition to those of the model."""
    keys = [key for key in cause.group if _shapes(result, key)]
    nuisances = _nuisances(result, set(cause.group))
    nothing = Separation(None, 0.0, separated_by(cause.group), 0)
    # predicted currents cannot discriminate causes that encoders, a tracker or a closed loop show
    if len(keys) < 2 or cause.signal is not Signal.CURRENT or _aliased({effect for effect, _ in keys}):
        return nothing
    rivals = [rival_of(_shapes(result, key), nuisances, result.fit, result.arm) for key in keys]
    joints = sorted({felt for _, joint in keys if (felt := joint or cause.felt_at)})
    return _best(Question(rivals, nuisances, result.fit, result.arm), result, joints, rig, progress) or nothing


def _aliased(effects: set[str]) -> bool:
    """Whether all are aliases of one of them: then no motion can discriminate them."""
    return any(effects <= {effect, *CATALOGUE[effect].aliases} for effect in effects)


@dataclass(frozen=True)
class _Discrimination:
    """A trial and how well it discriminates.

    pairs     pairs of rivals that it discriminates
    distance  smallest of their distances; of all pairs, where it discriminates none
    together  pairs that it does not discriminate
    """

    pairs: int
    distance: float
    kind: Kind = Kind.MOTION
    visited: bool = True
    trial: Trial | None = None
    together: tuple[tuple[EffectKey, EffectKey], ...] = ()


def _best(
    question: Question, result: Diagnosis, joints: Sequence[int], rig: Limits | None, progress: Progress
) -> Separation | None:
    """The best experiment of the first kind that discriminates all rivals: that with the largest smallest distance.

    If none does, the motion that discriminates most pairs; None if none discriminates any.
    """
    best, tried, stage = _Discrimination(0, 0.0), 0, stage_of(result, joints, rig, visited=True)
    for kind, visited in ((Kind.MOTION, True), (Kind.OFF, True), (Kind.PAYLOAD, True), (Kind.MOTION, False)):
        if (best.trial and not best.together) or (not visited and best.distance < HOPELESS):
            break
        if not visited:
            stage = stage_of(result, joints, rig, visited=False)
        for trial, distances in _tried(question, stage, joints, kind):
            tried += 1
            progress(Step("discriminating experiment", tried - 1, detail=f"motion {tried}"))
            far = [distance for distance in distances.values() if distance >= ENOUGH]
            together = tuple(pair for pair, distance in distances.items() if distance < ENOUGH)
            discrimination = _Discrimination(len(far), min(far or distances.values()), kind, visited, trial, together)
            same = (best.kind, best.visited) == (kind, visited)
            # an experiment that takes more work must discriminate more pairs, not the same ones more clearly
            if discrimination.pairs > best.pairs or (
                same and discrimination.pairs == best.pairs and discrimination.distance > best.distance
            ):
                best = discrimination
    return _described(best, best.trial, tried) if best.pairs and best.trial else None


def _tried(question: Question, stage: Stage, joints: Sequence[int], kind: Kind) -> Iterator[tuple[Trial, Distances]]:
    """Feasible trials of a kind with the distances of rivals; only every third one if none of these shows any."""
    motions = list(trials(stage, joints, kind))
    some = motions[::ONE_IN]
    largest = 0.0
    for number, trial in enumerate([*some, *(trial for k, trial in enumerate(motions) if k % ONE_IN)]):
        if number >= len(some) and largest < NOTHING:
            return
        run = predicted_run(trial, stage, question.noise)
        if run is not None:
            distances = question.pair_distances(run)
            largest = max(largest, *distances.values())
            yield trial, distances


def _described(discrimination: _Discrimination, trial: Trial, tried: int) -> Separation:
    words = f"{trial.words} ({demand_of(trial.experiment).duration:.0f} s in all)"
    if not discrimination.visited:
        words = further(words)
    if discrimination.together:
        pairs = ", ".join(f"{in_words(first)} and {in_words(second)}" for first, second in discrimination.together)
        words += f"; it does not discriminate {pairs}"
    return Separation(trial.experiment.model_copy(update={"description": words}), discrimination.distance, words, tried)


def further(words: str) -> str:
    """The description of a motion that exceeds the recorded positions, with a warning."""
    return f"{words}; this exceeds the recorded positions: make sure that the workspace is clear"


def stage_of(result: Diagnosis, joints: Sequence[int], rig: Limits | None, visited: bool) -> Stage:
    """The arm at the start of the recordings, and at the recorded pose whose load of the joint differs most."""
    q = np.concatenate([run.q[::20] for run in result.fit])
    box = np.column_stack([q.min(axis=0), q.max(axis=0)]) if visited else None
    limits = room(result.arm, box, rig)
    start = result.fit[0].q[0]
    inside = q[np.all((q >= limits.position[:, 0]) & (q <= limits.position[:, 1]), axis=1)]
    poses = [start]
    if len(inside):
        load = drive_rigid_torque(result.arm, inside, 0 * inside, 0 * inside)[:, joints[0] - 1]
        torque = drive_rigid_torque(result.arm, start[None], 0 * start[None], 0 * start[None])[0, joints[0] - 1]
        poses.append(inside[int(np.argmax(np.abs(load - torque)))])
    return Stage(result.arm, start, np.array(poses), limits)


def _shapes(result: Diagnosis, key: EffectKey) -> list[Candidate]:
    """All candidates of an effect at its joint; for a named cause also the one that was found, as the last."""
    shapes = [c for c in candidates(result.arm) if c.key == key]
    for cause in result.causes:
        if shapes and (cause.effect, cause.joint) == key:
            values = {p.name: p.value for p in cause.parameters if np.isfinite(p.value) and p.value != 0.0}
            as_found = tuple((name, values.get(name, value)) for name, value in shapes[0].shape)
            shapes = [*shapes, replace(shapes[0], shape=as_found)]
    return list(dict.fromkeys(shapes))


def _nuisances(result: Diagnosis, group: set[EffectKey]) -> list[Candidate]:
    """The causes outside of a group, as they were found."""
    keys = [(cause.effect, cause.joint) for cause in result.causes]
    return [shapes[-1] for key in keys if key not in group and (shapes := _shapes(result, key))]


def separated_by(group: Sequence[EffectKey]) -> str:
    """The experiments of the catalogue that discriminate the members of a group."""
    names = [effect for effect, _ in group]
    experiments = [CATALOGUE[a].confused_with[b] for a in names for b in names if b in CATALOGUE[a].confused_with]
    return "; ".join(dict.fromkeys(experiments)) or "no experiment in the catalogue"
