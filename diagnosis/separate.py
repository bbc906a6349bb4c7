"""The experiment that would tell the members of a group apart, or show an effect that could not be seen: chosen among many motions.

The motion wanted is the one whose smallest distance between the rivals' predictions is largest (``separate_distance``), among the families of
``separate_motions``, where the recordings have been already. A motion alone is preferred; then the drives off; then a known payload; then going
further than the recordings did. Where none of it separates (a reference shunt would, say), words from the catalogue say what does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_model.effects import CATALOGUE
from arm_model.rigid_body import rigid_torque
from diagnosis.candidates import Candidate, candidates
from diagnosis.diagnose import Cause, Diagnosis
from diagnosis.separate_distance import Key, Question, foreseen, rival_of
from diagnosis.separate_motions import Kind, Stage, Trial, room, trials
from experiment import Experiment, demand_of
from identification.excitation import Limits

Array = NDArray[np.float64]
Progress = Callable[[str], None]

ENOUGH = 10.0
"""Standard deviations of the noise by which predictions should differ: what the model does not know of the motion costs some of them."""

HOPELESS = 3.0
"""Standard deviations below which going further than the recordings did is not tried."""


@dataclass(frozen=True)
class Separation:
    """experiment: what to record (None: no motion separates); distance: standard deviations by which predictions then differ at least;
    words: what it is, for a person; tried: how many motions it was chosen from."""

    experiment: Experiment | None
    distance: float
    words: str
    tried: int


def separations(
    result: Diagnosis, rig: Limits | None = None, progress: Progress = lambda sentence: None
) -> dict[int, Separation]:
    """For every cause (by its place, from 0) that comes as a group, what would tell its members apart."""
    return {
        place: separation(cause, result, rig, progress)
        for place, cause in enumerate(result.causes)
        if len(cause.group) > 1
    }


def separation(
    cause: Cause, result: Diagnosis, rig: Limits | None = None, progress: Progress = lambda sentence: None
) -> Separation:
    """The experiment for the group of a cause; ``rig``: limits beside those of the model."""
    keys = [key for key in cause.group if _shapes(result, key)]
    others = _nuisances(result, set(cause.group))
    nothing = Separation(None, 0.0, in_words(cause.group), 0)
    if len(keys) < 2:
        return nothing
    rivals = [rival_of(_shapes(result, key), others, result.fit, result.arm) for key in keys]
    joints = sorted({joint or cause.felt_at for _, joint in keys})
    return _best(Question(rivals, others, result.fit, result.arm), result, joints, rig, progress) or nothing


def _best(
    question: Question, result: Diagnosis, joints: Sequence[int], rig: Limits | None, progress: Progress
) -> Separation | None:
    """The motion with the largest smallest distance, of the first kind in which one reaches ``ENOUGH``; None where none does."""
    tried, farthest_yet = 0, 0.0
    for kind, visited in ((Kind.MOTION, True), (Kind.OFF, True), (Kind.PAYLOAD, True), (Kind.MOTION, False)):
        if not visited and farthest_yet < HOPELESS:
            break
        stage = _stage(result, joints, rig, visited)
        best, farthest = None, 0.0
        for trial in trials(stage, joints, kind):
            run = foreseen(trial, stage, question.noise)
            if run is None:
                continue
            tried += 1
            progress(f"separating experiment: {tried} motions tried")
            distance = float(question.distances(run).min())
            if distance > farthest:
                best, farthest = trial, distance
        farthest_yet = max(farthest_yet, farthest)
        if best is not None and farthest >= ENOUGH:
            return _told(farthest, best, tried, beyond=not visited)
    return None


def _told(distance: float, trial: Trial, tried: int, *, beyond: bool) -> Separation:
    seconds = demand_of(trial.experiment).duration
    words = f"{trial.words} ({seconds:.0f} s)"
    if beyond:
        words += "; this goes further than the recordings did: see that the way is free"
    return Separation(trial.experiment.model_copy(update={"description": words}), distance, words, tried)


def _stage(result: Diagnosis, joints: Sequence[int], rig: Limits | None, visited: bool) -> Stage:
    """The arm at the pose in which the recordings start; and the pose they went through that loads the joint most differently."""
    q = np.concatenate([run.q[::20] for run in result.fit])
    box = np.column_stack([q.min(axis=0), q.max(axis=0)]) if visited else None
    limits = room(result.arm, box, rig)
    start = result.fit[0].q[0]
    inside = q[np.all((q >= limits.position[:, 0]) & (q <= limits.position[:, 1]), axis=1)]
    poses = [start]
    if len(inside):
        load = rigid_torque(result.arm, inside, 0 * inside, 0 * inside)[:, joints[0] - 1]
        here = rigid_torque(result.arm, start[None], 0 * start[None], 0 * start[None])[0, joints[0] - 1]
        poses.append(inside[int(np.argmax(np.abs(load - here)))])
    return Stage(result.arm, start, np.array(poses), limits)


def _shapes(result: Diagnosis, key: Key) -> list[Candidate]:
    """All shapes of an effect at its joint; where it is a named cause, the one that was found among them."""
    several = [c for c in candidates(result.arm) if c.key == key]
    for cause in result.causes:
        if several and (cause.effect, cause.joint) == key:
            values = {p.name: p.value for p in cause.parameters if np.isfinite(p.value) and p.value != 0.0}
            own = tuple((name, values.get(name, value)) for name, value in several[0].shape)
            several = [*several, replace(several[0], shape=own)]
    return list(dict.fromkeys(several))


def _nuisances(result: Diagnosis, group: set[Key]) -> list[Candidate]:
    """The causes beside a group, as they were found."""
    keys = [(cause.effect, cause.joint) for cause in result.causes]
    return [shapes[-1] for key in keys if key not in group and (shapes := _shapes(result, key))]


def in_words(group: Sequence[Key]) -> str:
    """What the catalogue knows to separate the members of a group; none of it is a motion."""
    names = [effect for effect, _ in group]
    said = [CATALOGUE[a].confused_with[b] for a in names for b in names if b in CATALOGUE[a].confused_with]
    return "; ".join(dict.fromkeys(said)) or "no motion of this arm separates them"
