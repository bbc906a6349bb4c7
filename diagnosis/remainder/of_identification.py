"""Residual that an identified model leaves on the recordings of its own identification, above their noise.

``identify`` writes it beside the model, because no model has exactly the structure of its arm. A residual that is no
larger on another day does not show a change of the arm, whatever variable it depends on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_model import Arm
from arm_model.tables import Uncertainty
from daq.recording import Recording
from diagnosis.cause import Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.closed_loop.loop_errors import left_over_in_loop
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import StructureSearch
from diagnosis.measurements.near_rest.friction import left_over_near_rest
from diagnosis.remainder.against_noise import runs_of
from diagnosis.remainder.aliased_shares import aliased_shares
from diagnosis.selection.design import Dataset
from diagnosis.selection.regression import fit_together
from diagnosis.selection.ripple_orders import joint_of_ripple, of_shafts, strongest_gain
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class LeftOver:
    """Per joint: rms N m (N) along the measured motion, in closed loop from 10 to 100 Hz, and near rest.

    against: the variable of the first; "" where it is noise, depends on no single variable, or no other recording could
    show on which. near_rest: None where no recording shows the joint turning or creeping. ripple: share of the squares
    of the first that the strongest ripple of the joint explains, in these recordings or in the others; at most 1.
    aliased: share of them along each effect by its name (``aliased_shares``).
    """

    along: tuple[float, ...]
    in_loop: tuple[float, ...]
    against: tuple[str, ...]
    near_rest: tuple[float | None, ...]
    ripple: tuple[float, ...]
    aliased: tuple[tuple[str, float], ...]

    def added_to(self, known: Uncertainty) -> Uncertainty:
        """The uncertainty ``known`` of a model, with this as what the model leaves."""
        return replace(
            known,
            left_over=self.along,
            in_loop=self.in_loop,
            against=self.against,
            near_rest=self.near_rest,
            ripple=self.ripple,
            aliased=self.aliased,
        )


def left_over(arm: Arm, recordings: Sequence[Recording], others: Sequence[Recording]) -> LeftOver:
    """Residual of ``arm`` in ``recordings`` above the noise, in rows in which a joint moves, away from reversals.

    others: of the same rig, whose standstills show its noise as well, and from which variables are learned.
    InputError where a recording is not one that ``diagnose`` takes.
    """
    data = dataset_of(runs_of(arm, recordings, others))
    learned = dataset_of(runs_of(arm, others, recordings)) if others else None
    every = [*data.runs, *(learned.runs if learned else ())]
    exact = [replace(run, arm=replace(run.arm, uncertainty=None)) for run in every]
    along = _along(arm, data)
    return LeftOver(
        along=along,
        in_loop=tuple(left_over_in_loop(arm, recordings).tolist()),
        against=tuple("" if learned is None else _against(arm, learned, data, j + 1) for j in range(len(arm))),
        near_rest=tuple(left_over_near_rest(exact, j + 1) for j in range(len(arm))),
        ripple=tuple(max(_of_ripple(arm, part, j + 1) for part in (data, learned) if part) for j in range(len(arm))),
        aliased=tuple(aliased_shares(arm, every, along).items()),
    )


def _along(arm: Arm, data: Dataset) -> tuple[float, ...]:
    """(n,) N m (N); 0 for a joint without any row."""
    found = []
    for j, constant in enumerate(arm.joint_array("drive_constant").tolist()):
        sure = data.comparable(j + 1)
        noise = np.concatenate([run.deviation[:, j] for run in data.runs])[sure]
        beyond = float(np.sum((data.y[data.of(j + 1)][sure] ** 2 - 1.0) * noise**2)) / max(int(sure.sum()), 1)
        found.append(constant * float(np.sqrt(max(beyond, 0.0))))
    return tuple(found)


def _of_ripple(arm: Arm, data: Dataset, joint: int) -> float:
    """Share of the squares beyond the noise at a joint (from 1) that the strongest ripple explains; 1 of no squares."""
    own = [c for c in (*candidates(arm), *of_shafts(arm)) if joint_of_ripple(c) == joint]
    beyond = float(np.sum(data.y[data.of(joint)][data.comparable(joint)] ** 2 - 1.0))
    explained = strongest_gain(data, data.y, arm, joint, own)
    return explained / beyond if explained < beyond else 1.0


def _against(arm: Arm, learned: Dataset, data: Dataset, joint: int) -> str:
    """Name of the variable that predicts most of what is left at a joint (from 1), from the ``learned`` recordings."""
    if noise_ratio(data.y, data, joint) <= LIMITS.above_noise:
        return ""
    split, bases = Split(learned, data), Bases(learned, data)
    exact = Significance(split, [], None)
    return _variable(StructureSearch(split, fit_together(split, ()), arm, exact, bases).at(joint)[0])


@dataclass(frozen=True, kw_only=True)
class AllowedResidual:
    """A residual at a joint (from 1) above the noise, but within the stated uncertainty of an identified model.

    against  variable that predicts most of it; "" where none does
    before   times the noise that the model left when it was identified; before_against: the variable then, or ""
    """

    joint: int
    against: str
    before: float
    before_against: str


def allowed_residuals(state: State, structures: Sequence[Structure]) -> list[AllowedResidual]:
    """Of every joint above the noise without unexplained structure.

    Empty if the model states no uncertainty, and in the recordings of its identification.
    """
    model, result = state.model, list[AllowedResidual]()
    known = model.arm.uncertainty
    if model.uncertain is None or known is None or known.same_day:
        return result
    exact = Significance(state.data, [*model.free, *(model.columns(c) for c in state.chosen)], None)
    variables = known.against or ("",) * len(model.arm)
    reported, bases = {structure.joint for structure in structures}, Bases(*state.data)
    for joint, (remaining, before) in enumerate(zip(model.uncertain.left_over.tolist(), variables), 1):
        sides = zip(state.data, state.residual)
        if joint in reported or max(noise_ratio(y, side, joint) for side, y in sides) <= LIMITS.above_noise:
            continue
        against = _variable(StructureSearch(state.data, state.fitted, model.arm, exact, bases).at(joint)[0])
        result.append(
            AllowedResidual(joint=joint, against=against, before=(1.0 + remaining) ** 0.5, before_against=before)
        )
    return result


def _variable(structures: Sequence[Structure]) -> str:
    return next((structure.against for structure in structures if structure.against != NO_VARIABLE), "")
