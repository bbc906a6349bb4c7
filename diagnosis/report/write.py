"""Writes diagnosis.json, report.html, model.toml and the proposed experiments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from arm_io.whole_folder import whole_folder
from arm_model import write_model
from arm_model.effects import CATALOGUE
from arm_report import write_report
from daq.recording import Recording
from diagnosis.cause import Cause, Estimate, in_words
from diagnosis.closed_loop import clear_errors, friction, lost_rows, resonance
from diagnosis.experiments.discriminating import Separation, separations
from diagnosis.experiments.revealing import DetectionExperiment, detection_experiments
from diagnosis.measurements.currents import limits as currents
from diagnosis.measurements.demands import wrist_coupling
from diagnosis.measurements.link_encoders import model as link_encoders
from diagnosis.measurements.near_rest import friction as near_rest
from diagnosis.measurements.single_axis import model as single_axis
from diagnosis.measurements.tracker import model as tracker
from diagnosis.origins import JUDGEMENT
from diagnosis.remainder.of_identification import AllowedResidual
from diagnosis.report.html import report
from diagnosis.report.joint_verdicts import remaining
from diagnosis.report.origins import of_cause, origin_row
from diagnosis.report.signals import signal_rows
from diagnosis.result import Diagnosis
from experiment import Experiment, write_experiment
from identification.experiment_design import Limits
from identification.selection import Thresholds

SCHEMA = "armscope.diagnosis/1"
LIMITS: dict[str, Thresholds] = {
    "currents": currents.LIMITS,
    "near_rest": near_rest.LIMITS,
    "single_axis": single_axis.LIMITS,
    "link_encoders": link_encoders.LIMITS,
    "tracker": tracker.LIMITS,
    "demands": wrist_coupling.LIMITS,
    "closed_loop": resonance.LIMITS,
    "friction_in_loop": friction.LIMITS,
    "lost_rows": lost_rows.LIMITS,
    "verdict": clear_errors.LIMITS,
}
"""Thresholds of every measurement model."""


def table_of(result: Diagnosis, fit: list[Recording], held_out: list[Recording]) -> dict[str, Any]:
    """The content of diagnosis.json."""
    suspected, (fit, held_out) = result.origins, result.roles(fit, held_out)
    return {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "fit": list(dict.fromkeys(str(r.path) for r in fit)),  # each once, however many stretches of it were examined
        "held_out": list(dict.fromkeys(str(r.path) for r in held_out)),
        "recorded": min((r.date for r in fit if r.date), default=None),
        "signals": signal_rows(result),
        "joints": [
            {"joint": one.joint, "verdict": one.verdict, "noise_ratio": one.along, "closed_loop": one.in_loop}
            | ({} if one.known_to is None else {"known_to": one.known_to, "known_to_fitted": one.known_to_fitted})
            | ({} if one.remainder is None else {"remainder": _remainder(one.remainder)})
            for one in remaining(result)
        ],
        "causes": [_cause(cause) | {"origins": of_cause(cause, suspected)} for cause in result.causes],
        "origins": [origin_row(one) for one in suspected],
        "origins_are": JUDGEMENT,
        "not_visible": [
            {"effect": one.effect, "joint": one.joint, "why": one.why, "experiment": one.experiment}
            for one in result.undetectable
        ],
        "unexplained": [
            {
                "signal": structure.signal,
                "joint": structure.joint,
                "against": structure.against,
                "share": round(structure.share, 4),
                "size": structure.size or None,
            }
            for structure in result.unexplained
        ],
        "too_short": [str(result.shortage)] if result.shortage else [],
        "seconds_needed": result.shortage.seconds if result.shortage else 0.0,
        "warnings": list(result.warnings),
        "limits": {name: limits.to_json() for name, limits in LIMITS.items()},
    }


def _values(parameters: Sequence[Estimate]) -> dict[str, dict[str, Any]]:
    return {
        p.name: {"value": p.value, "std": p.std, "unit": p.unit}
        | ({} if p.of_own is None else {"of_own": round(p.of_own, 4)})
        for p in parameters
    }


def _terms(cause: Cause) -> list[dict[str, Any]]:
    """Next-order terms of its law that a cause has, with the parameters that are theirs."""
    effect = CATALOGUE[cause.effect]
    return [{"term": term, "parameters": [effect.of_term(term).name]} for term in cause.next_orders]


def _remainder(one: AllowedResidual) -> dict[str, Any]:
    """On what a residual within the model's uncertainty depends, and what the model left when it was identified."""
    before = {"noise_ratio": one.before, "against": one.before_against or None}
    return {"against": one.against or None, "when_identified": before}


def _cause(cause: Cause) -> dict[str, Any]:
    where_any = {
        "joints": [{"joint": joint, "parameters": _values(own)} for joint, own in cause.of_joints.items()],
        "recordings": [{"file": name, "parameters": _values(own)} for name, own in cause.of_recordings.items()],
        "harmonics": [asdict(term) for term in cause.harmonics],
        "lost_rows": [asdict(one) for one in cause.lost_rows],
        "encoder_jumps": [asdict(one) for one in cause.encoder_jumps],
        "terms": _terms(cause) if cause.next_orders else [],
        "remainder": asdict(cause.remainder) if cause.remainder else None,
        "rise_at_rest": asdict(cause.rise_at_rest) if cause.rise_at_rest else None,
    }
    return {
        "effect": cause.effect,
        "joint": cause.joint,
        "parameters": _values(cause.parameters),
        **{name: value for name, value in where_any.items() if value},
        "confidence": round(cause.confidence, 4),
        **({"deviations": dict(zip(("exact", "known"), cause.deviations))} if cause.deviations else {}),
        "support": asdict(cause.support) if cause.support else None,
        "gain": {"held_out_rms_before": cause.before, "held_out_rms_after": cause.after, "unit": cause.unit},
        "group": [{"effect": effect, "joint": joint} for effect, joint in cause.group],
        "separate_by": cause.separate_by,
        "evidence": cause.evidence,
    }


@dataclass(frozen=True, kw_only=True)
class Experiments:
    """Experiments proposed and recorded on a rig.

    separate  ``diagnosis.experiments.separations`` of the result; None: they are searched for while writing
    recorded  those that led to this result
    limits    of the rig, in addition to those of the model
    """

    separate: Mapping[int, Separation] | None = None
    recorded: Sequence[Mapping[str, Any]] = ()
    limits: Limits | None = None


NONE = Experiments()


def write_diagnosis(
    out: Path,
    result: Diagnosis,
    fit: list[Recording],
    held_out: list[Recording],
    experiments: Experiments = NONE,
    progress: Callable[[str], None] = lambda sentence: None,
    pictures: Collection[str] = (),
) -> dict[str, Any]:
    """Writes DIR/diagnosis.json, report.html, model.toml, the proposed experiments, and charts as ``pictures``.

    separate_K.toml discriminates the ambiguity group of cause K; show_K.toml makes effects detectable that these
    recordings could not show.
    """
    with whole_folder(out, "diagnosis") as there:
        table = table_of(result, fit, held_out)
        for place, found in (separations(result) if experiments.separate is None else experiments.separate).items():
            row = table["causes"][place]
            row["separate_by"], row["separation"] = found.words, None
            if found.experiment is not None:
                name = f"separate_{place + 1}.toml"
                write_experiment(there / name, found.experiment, heading=_heading(result.causes[place], found))
                row["separate_by"] = str(out / name)
                row["separation"] = {"motion": found.words, "distance": round(found.distance, 1), "tried": found.tried}
        _add_detection_experiments(there, table, detection_experiments(result, experiments.limits, progress))
        if experiments.recorded:
            table["experiments"] = [dict(one) for one in experiments.recorded]
        progress("report")
        _, held_out = result.roles(fit, held_out)
        write_model(there / "model.toml", result.extended)
        return write_report(there, ("report.html", "diagnosis.json"), report(result, table, held_out), table, pictures)


def _add_detection_experiments(out: Path, table: dict[str, Any], showing: Sequence[DetectionExperiment]) -> None:
    """Adds the detection experiments, and writes show_K.toml for every motion among them."""
    written: list[Experiment] = []
    for row, one in zip(table["not_visible"], showing):
        row["experiment"] = one.undetectable.experiment
        if one.experiment is not None:
            if one.experiment not in written:
                written.append(one.experiment)
                write_experiment(out / f"show_{len(written)}.toml", one.experiment)
            row["experiment"] += f"; show_{written.index(one.experiment) + 1}.toml"


def _heading(cause: Cause, separation: Separation) -> str:
    members = ", ".join(map(in_words, cause.group))
    return (
        f"Discriminates {members}.\n{separation.words[:1].upper()}{separation.words[1:]}.\n"
        f"Discrimination distance: {separation.distance:.0f} standard deviations of the noise,\n"
        f"the largest of {separation.tried} motions."
    )
