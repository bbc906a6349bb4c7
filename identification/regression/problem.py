"""Recordings -> what is regressed: check -> smooth -> equations -> base parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.effects import CATALOGUE, coupled
from arm_model.friction_split import split_arm
from arm_model.tables import recorded_temperatures
from arm_report.numbers import numbered
from daq.recording import Recording
from identification.preprocessing import checks
from identification.preprocessing.filtering import butterworth, zero_phase
from identification.preprocessing.quality import trusted
from identification.preprocessing.readiness import Excitation, RunReadiness, readiness_of
from identification.preprocessing.run_warnings import said_once
from identification.preprocessing.setpoint_ripple import Driven, folded_torque
from identification.preprocessing.setpoints import Setpoints, setpoints_of
from identification.preprocessing.signals import Motion, smooth_motion, spared, with_reversals
from identification.regression.base_parameters import BaseParameters, base_parameters, structural_base
from identification.regression.effect_columns import effects_held_fixed, repeated, true_readings
from identification.regression.equations import Equations, described_rows, equations, equations_of, with_effects
from identification.regression.least_squares import weighted
from identification.regression.model_parameters import Friction, freed_rotors, model_values

TREMBLE = 20.0
"""Travel, in rms of the angle's noise, below which a joint only trembles."""
SHAKEN = 0.01
"""Share of the largest travel (of joints of its kind) below which a joint is only shaken by the others."""
SLOW = 10.0
"""Hz: accelerations below this are taken as demanded, if the setpoints' rate is not stated."""
EXCITED = 1e-4
"""Share of a column that no other explains: with less, the parameter is not excited by these runs."""


@dataclass(frozen=True)
class Problem:
    """What is regressed: the arm, the runs, their rows and the columns that this data excites.

    base    what the arm could show; excited: indices into it that this data shows
    rows    those that are fitted; judged, held: those, reversals and all, of the fitted and the held-out runs (None:
            split) to judge on
    runs    how fit each recording is, fitted ones first
    start   the arm at whose values the rows are linearised; None: ``arm``
    """

    arm: Arm
    friction: Friction
    fit: Sequence[Recording]
    held_out: Sequence[Recording]
    motions: list[Motion]
    held_motions: list[Motion]
    rows: Equations
    judged: Equations
    held: Equations | None
    base: BaseParameters
    excited: NDArray[np.intp]
    warnings: list[str]
    runs: list[RunReadiness]
    start: Arm | None = None

    @property
    def columns(self) -> NDArray[np.intp]:
        """Indices of the excited base parameters' columns among the standard ones."""
        return self.base.kept[self.excited]

    @property
    def top_speeds(self) -> Array:
        """(n,) rad/s (m/s): the highest speed of each joint in any of the runs."""
        return np.max([np.abs(motion.qd).max(axis=0) for motion in [*self.motions, *self.held_motions]], axis=0)

    def given_torque(self, rows: Equations) -> Array:
        """(rows,) torque of unexcited base parameters at the model's values, and torque that belongs to no column."""
        silent = np.setdiff1d(np.arange(len(self.base)), self.excited)
        values = self.base.grouping[silent] @ model_values(self.arm, self.friction)
        torque = rows.columns[:, self.base.kept[silent]] @ values
        return np.asarray(torque if rows.rest is None else torque + rows.rest)

    def doubting(self, error: Array) -> Problem:
        """The problem with one more systematic error of its torques: (rows,) N m (N) of one standard deviation."""
        rows = self.rows
        known = np.zeros((len(rows), 0)) if rows.systematic is None else rows.systematic
        return replace(self, rows=replace(rows, systematic=np.column_stack([known, error])))

    def around(self, arm: Arm) -> Problem:
        """The same equations with effects taken at the values of ``arm``.

        Base parameters that show only there (what a coupling turns had no mass in the model) are excited from then on.
        """
        still = coupled(arm) == arm and coupled(self.arm) == self.arm

        def at(rows: Equations, motions: list[Motion]) -> Equations:
            if not still:
                rows = replace(rows, columns=described_rows(arm, motions, motions, self.friction))
            return with_effects(rows, arm, self.arm, motions, self.friction, self.base)

        rows, judged = at(self.rows, self.motions), at(self.judged, list(map(with_reversals, self.motions)))
        held = None if self.held is None else at(self.held, self.held_motions)
        moved, excited = replace(self, rows=rows, judged=judged, held=held), excited_of(rows, self.base, self.arm)
        if len(excited) <= len(self.excited):
            return moved
        others = [warning for warning in self.warnings if warning not in unexcited(self.base, self.excited)]
        return replace(moved, excited=excited, warnings=others + unexcited(self.base, excited))


def _has_springs(arm: Arm) -> bool:
    """Whether the model states a soft gear: what servos repeat above their demands moves it against its link."""
    return any(CATALOGUE[term.name].spring is not None for term in arm.effects)


def motion_of(recording: Recording, arm: Arm) -> tuple[Motion, RunReadiness]:
    """The smooth motion of a recording, and how fit it is.

    Torques are its currents times the arm's drive constants; errors of angle and time that the arm has as effects are
    corrected, rows that the instruments flagged are left out.
    """
    found = trusted(recording)
    q, current = true_readings(arm, recording.t, found.q, found.i)
    torque = current * arm.joint_array("drive_constant")
    motion = smooth_motion(recording.t, q, torque, saturated=found.saturated)
    checks.check_motion(recording.path, motion)
    motion = motion.without(resting(motion, arm), "at rest")
    setpoints = _setpoints_of(recording, arm, motion, torque)
    motion = replace(
        motion,
        band=motion.band.below(0.5 / setpoints.period) if setpoints.period and _has_springs(arm) else motion.band,
        setpoints=setpoints,
        folded=folded_torque(motion, Driven(recording.t, torque, setpoints)),
        temperatures=recorded_temperatures(recording.t, recording.temp),
        revolute=np.array([joint.revolute for joint in arm.joints]),
    )
    return motion, readiness_of(recording, found, motion, arm)


def _setpoints_of(recording: Recording, arm: Arm, motion: Motion, torque: Array) -> Setpoints:
    """The setpoints of a recording with this smooth motion and recorded torques (n, J) N m (N)."""
    t = recording.t - recording.t[0]

    def currents() -> tuple[Array, Array]:
        low_pass = butterworth(4, 2 * min(motion.band.parallel, SLOW) * motion.dt)
        slow = zero_phase(low_pass, motion.qdd)
        smooth, pushed = (np.column_stack([np.interp(t, motion.t, x) for x in y.T]) for y in (motion.torque, slow))
        return torque - smooth, pushed

    return setpoints_of(arm, recording.dt, demands=recording.qref, currents=currents)


def resting(motion: Motion, arm: Arm) -> NDArray[np.bool_]:
    """(J,) joints that rest for the whole run, or tremble within a few encoder steps.

    Friction holds them: their drives may bear any torque within it, so that nothing can be learnt from a row of theirs.
    """
    travel = np.ptp(motion.q, axis=0)
    revolute = np.array([joint.revolute for joint in arm.joints])
    liveliest = np.array([travel[revolute == kind].max() for kind in revolute])
    return np.asarray(travel <= np.maximum(TREMBLE * motion.band.noise_rms, SHAKEN * liveliest))


def motions_of(
    fit: Sequence[Recording], held_out: Sequence[Recording], arm: Arm, progress: Progress
) -> tuple[list[Motion], list[Motion], list[RunReadiness]]:
    """Smooth motions of the fitted and of the held-out recordings, and how fit each is.

    InputError for one that cannot be used at all.
    """
    for recording in [*fit, *held_out]:
        checks.check_recording(recording, arm)
    seen: list[tuple[Motion, RunReadiness]] = []
    for recording in (every := [*fit, *held_out]):
        progress(Step("smoothing", len(seen), len(every), detail=recording.path.name))
        seen.append(motion_of(recording, arm))
    return (
        spared([motion for motion, _ in seen[: len(fit)]]),
        spared([with_reversals(motion) for motion, _ in seen[len(fit) :]]),
        said_once([run for _, run in seen], [motion for motion, _ in seen], arm),
    )


def prepare(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    friction: Friction = "symmetric",
    progress: Progress = lambda _: None,
    sparse: bool = False,
) -> Problem:
    """Checks the recordings and makes their equations; InputError if they cannot be used.

    ``sparse``: the runs are of one joint each and need not excite the whole arm.
    """
    motions, held_motions, runs = motions_of(fit, held_out, arm, progress)
    arm = split_arm(arm)
    # Ripples reach to the low-pass's edge, where both sides differ; leaving samples out would fold that onto the
    # motion. Friction is as uncertain in reversals as without effects.
    effects = [CATALOGUE[term.name] for term in arm.effects]
    smooth = all(effect.conditional or effect.friction or effect.delay is not None for effect in effects)
    motions = motions if smooth else [*map(with_reversals, motions)]
    warnings = [warning for run in runs for warning in run.warnings]
    warnings += [
        f"{name}: keeps the values of the model, and is taken as rigid or sliding here"
        for name in effects_held_fixed(arm)
    ]
    warnings += [f"{name} is in the model more than once: only the first is fitted" for name in repeated(arm)]
    if freed := freed_rotors(arm):
        which = numbered("joint", freed)
        warnings.append(
            f"the model has no rotor inertia at {which}: it is identified here, for there is a gear or a load to lift; "
            "at the joint side (gear^2 times the motor's), alone if the motions distinguish it from the link's inertia"
        )
    progress("equations of motion")
    base = structural_base(arm, friction)
    views = [motions, list(map(with_reversals, motions))]
    rows, judged = equations_of(arm, views, friction, base)
    held = equations(arm, held_motions, friction, base) if held_motions else None
    if len(rows) < (1 if sparse else 2) * len(base):
        raise checks.too_short([recording.path for recording in fit], len(rows), len(base))
    excited = excited_of(rows, base, arm)
    warnings += [] if sparse else unexcited(base, excited)
    return Problem(
        arm, friction, fit, held_out, motions, held_motions, rows, judged, held, base, excited, warnings, runs
    )


def unexcited(base: BaseParameters, excited: NDArray[np.intp]) -> list[str]:
    """A warning that names the base parameters that are not among the ``excited``; none where all are."""
    silent = [base.expression(int(k)) for k in np.setdiff1d(np.arange(len(base)), excited)]
    if not silent:
        return []
    are = "is" if len(silent) == 1 else "are"
    return [
        f"{len(silent)} of {len(base)} base parameters {are} not excited by these runs and keep the model's values: "
        f"{', '.join(silent)}"
    ]


def excited_of(rows: Equations, base: BaseParameters, arm: Arm) -> NDArray[np.intp]:
    """(e,) indices, in order, of the base parameters that these rows show."""
    shown = rows.columns[:, base.kept] / _torque_std(rows, arm)[:, None]
    labels = [base.names[k] for k in base.kept]
    return np.sort(base_parameters(shown, labels, order=range(len(base)), negligible=EXCITED).kept)


def _torque_std(rows: Equations, arm: Arm) -> Array:
    """(rows,) standard deviation of the torque of each row's joint."""
    torques = [rows.torque[rows.joint == j] for j in range(len(arm))]
    return np.array([max(float(np.std(torque)), 1e-12) if len(torque) else 1.0 for torque in torques])[rows.joint]


def excitation_of(problem: Problem) -> Excitation:
    """How well the fitted runs excite the arm's parameters, before anything is fitted.

    The rows of each joint are divided by the std of its torque.
    """
    base, rows = problem.base, problem.rows
    fit = weighted(rows.columns[:, problem.columns], rows.torque, 1 / _torque_std(rows, problem.arm))
    silent = [base.expression(int(k)) for k in np.setdiff1d(np.arange(len(base)), problem.excited)]
    return Excitation(len(problem.excited), len(base), fit.condition, silent)
