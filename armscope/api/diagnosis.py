"""Recordings and a model in; what the model's simulation gets wrong, why, and the extended model out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io.progress import silent
from armscope.api.reading import File, Source, check_distinct, fixed_model, for_analysis

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from arm_model import Arm
    from daq.recording import Recording
    from diagnosis import Cause, Structure, Undetectable
    from diagnosis import Diagnosis as Details
    from diagnosis.origins import Suspect

MOST_NUMBERS = 21_600_000
"""Rows times joints that are read of each signal: an hour of six joints at 1 kHz.

Of more, or faster ones, rows are averaged.
"""
RATE = 1000.0
"""rows/s that a diagnosis can use."""


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis:
    """What ``diagnose`` returns.

    details        everything that was found: ``diagnosis.Diagnosis``
    fit, held_out  the recordings in which causes were found, and those that judge them
    """

    details: Details
    fit: tuple[Recording, ...]
    held_out: tuple[Recording, ...]

    @property
    def verdict(self) -> str:
        """``consistent``, ``explained`` or ``unexplained``; of what could be judged where ``too_short`` says more."""
        return self.details.verdict

    @property
    def too_short(self) -> str | None:
        """What could not be judged because rows are too few, and how many s more are needed; None if all was judged."""
        return None if self.details.shortage is None else str(self.details.shortage)

    @property
    def causes(self) -> list[Cause]:
        """The accepted causes, strongest first, with parameters, confidence, gain and ambiguity group."""
        return list(self.details.causes)

    @property
    def unexplained(self) -> list[Structure]:
        """Structure that no effect of the catalogue explains: signal, joint, and the variable that it depends on."""
        return list(self.details.unexplained)

    @property
    def undetectable(self) -> list[Undetectable]:
        """Effects that these recordings could not show, each with the reason and a motion that would show it."""
        return list(self.details.undetectable)

    @property
    def warnings(self) -> list[str]:
        """Sentences on the recordings and the model that qualify the verdict."""
        return list(self.details.warnings)

    @property
    def origins(self) -> list[Suspect]:
        """Physical origins of the causes, per joint and of the arm: likelihood, check and source of each.

        Likelihoods are engineering judgement, not measured frequencies; they order what to check first.
        """
        return self.details.origins

    @property
    def extended(self) -> Arm:
        """The model with every cause as an effect of its own."""
        return self.details.extended

    def __repr__(self) -> str:
        causes = [cause.effect + (f" of joint {cause.joint}" if cause.joint else "") for cause in self.details.causes]
        verdict = "too short to judge" if self.too_short else self.verdict
        return f"<Diagnosis of {self.details.arm.name}: {verdict}{': ' * bool(causes)}{', '.join(causes)}>"

    def __str__(self) -> str:
        from diagnosis.report import diagnosis_text

        return diagnosis_text(self.details, self.to_json())

    def _repr_html_(self) -> str:
        from arm_report import inline
        from diagnosis.report import report

        return inline(report(self.details, self.to_json(), self.held_out).html())

    def to_json(self) -> dict[str, Any]:
        """The content of diagnosis.json, without the discriminating experiments: ``write`` looks for them."""
        from diagnosis.report import table_of

        return table_of(self.details, list(self.fit), list(self.held_out))

    def to_pandas(self) -> pandas.DataFrame:
        """A row per parameter of each cause, by effect: joint (from 1), parameter, value, std, unit, confidence, gain.

        error_before, error_after  rms of the held-out residual without and with the cause, in error_unit
        alternatives               effects that these recordings cannot distinguish from the cause
        InputError where pandas is not installed.
        """
        from diagnosis.report import causes_frame

        return causes_frame(self.details)

    def plot(self) -> Figure:
        """Held-out residual current of every joint over time, in units of the noise, before and after."""
        from arm_report import figure
        from diagnosis.report import overview

        return figure(overview(self.details))

    def write(
        self,
        folder: str | PathLike[str],
        *,
        progress: Callable[[str], None] = silent,
        pictures: Collection[str] = (),
    ) -> dict[str, Any]:
        """Writes diagnosis.json, report.html, model.toml and the discriminating experiments.

        pictures  "png", "pdf": the charts as files of these kinds, too
        Returns what diagnosis.json says.
        """
        from diagnosis.report import write_diagnosis

        fit, held_out = list(self.fit), list(self.held_out)
        return write_diagnosis(Path(folder), self.details, fit, held_out, progress=progress, pictures=pictures)


def diagnose(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    progress: Callable[[str], None] = silent,
) -> Diagnosis:
    """What a model's simulation gets wrong in recordings of the arm, and why.

    recordings  to find causes in: one or several, as paths or objects; of very long ones the rows are averaged as they
                are read
    model       the nominal model, whose simulation is judged
    held_out    other recordings, which judge; without any, the last 40 % of each recording, a weaker test
    Raises InputError where a recording does not belong to the arm, or is both fitted and held out.
    """
    arm = fixed_model(model, "'armscope diagnose'")
    fit, held, remarks = fit_and_held_out(recordings, held_out)
    from diagnosis import diagnose

    details = diagnose(arm, fit, held, progress=progress)
    return Diagnosis(replace(details, warnings=(*remarks, *details.warnings)), tuple(fit), tuple(held))


def fit_and_held_out(
    fit: Source | Sequence[Source], held_out: Source | Sequence[Source]
) -> tuple[list[Recording], list[Recording], tuple[str, ...]]:
    """Fit and held-out recordings, read; without held-out ones each recording is split by time.

    Very long recordings are read as stretches; the third value has the remarks about this.

    InputError where a recording is on both sides.
    """
    fitted, held = for_analysis(fit, held_out, most_numbers=MOST_NUMBERS, rate=RATE)
    check_distinct(fitted, held)
    from diagnosis.screening import examined, split

    if not held:
        fitted, held = (list(parts) for parts in zip(*map(split, fitted)))
    fitted, held, remark = examined(fitted, held)
    averaged = [
        f"{one.path.name}: each row used is the mean of {one.averaged} recorded ones"
        for one in {one.path: one for one in [*fitted, *held]}.values()
        if one.averaged > 1
    ]
    return fitted, held, (*averaged, *([] if remark is None else [remark]))
