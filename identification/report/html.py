"""report.html: one file that opens anywhere, without a network: numbers, uncertainties, predictions, spectra."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from arm_model.collision import chain_of
from arm_report import Report, table
from arm_report.motion import Motion
from arm_report.numbers import significant, value_and_two_std
from identification.regression.model_parameters import without_rotors
from identification.report import friction, plots, ripples
from identification.signal_words import recorded_quantities

if TYPE_CHECKING:
    from identification.result import Identification, Value

METHODS = {
    "ols": "ordinary least squares on the inverse dynamics",
    "wls": "least squares on the inverse dynamics, joints weighted by their noise",
    "irls": "iteratively reweighted (robust) least squares on the inverse dynamics",
    "iv": "instrumental variables from the simulated closed loop",
    "didim": "closed-loop output error: torque of the simulated closed loop fitted to the measured one",
    "motor-link": "each joint as one motor and one link",
    "sequence": "link after link from the tip, each step keeping the parameters found before",
    "friction": "friction tuned until the simulated currents match the measured ones",
}


def report(result: Identification) -> Report:
    """The whole page."""
    base = [value for value in result.base if ".curve" not in value.name]
    return Report(
        title=f"{result.arm.name}: identification",
        template="identification.report/identification.html",
        joints=[joint.name for joint in result.arm.joints],
        motion=Motion(arm=chain_of(result.arm).to_json(), clips=result.clips) if result.clips else None,
        content={
            "what": _what(result),
            "says": verdict(result),
            "measured": recorded_quantities(result.arm),
            "refuted": _refuted(result),
            "warnings": result.warnings,
            "errors": _errors(result),
            "totals": _totals(result),
            "predictions": list(plots.predictions(result)),
            "friction_said": friction.sentences(result),
            "ripples_said": ripples.sentences(result),
            "friction": friction.curves(result),
            "friction_values": friction.values(result),
            "recordings": _recordings(result),
            "base": _values(base, "base parameter"),
            "condition": None if result.condition != result.condition else f"{result.condition:.3g}",
            "parameters": _values(result.parameters, "parameter"),
            "spectra": plots.spectra(result),
            "notes": result.notes,
        },
    )


WHAT_IT_LACKS = (
    "armscope diagnose of the same recordings looks for what the model lacks, such as an elastic gear, and writes a "
    "model that has it."
)
"""What to do where a model is not validated."""


def _what(result: Identification) -> str:
    names = ", ".join(Path(path).name for path in result.fit)
    judged = "" if isinstance(result.held_out, str) else ", ".join(Path(path).name for path in result.held_out)
    how = METHODS.get(result.method, result.method)
    return f"Parameters from {names}{f', validated on {judged}' if judged else ''}: {how}; {result.friction} friction."


def _refuted(result: Identification) -> bool:
    above = any(one.above for one in result.noise or ())
    return above or (result.held_out != "split" and bool(result.joints_above_expected()))


def verdict(result: Identification) -> str:
    """The first sentences: the error of model.toml, whether it is more than noise, and what held-out rows chose."""
    return f"{_validated(result)}{_chosen(result)}"


def _chosen(result: Identification) -> str:
    """What of the model the held-out rows chose, which they therefore do not judge as new rows would; or nothing."""
    if not result.chosen_on_held_out:
        return ""
    rows = "the last part of the runs" if result.held_out == "split" else "the held-out recordings"
    return (
        f" Terms of the model were chosen by their error on {rows}: {', '.join(result.chosen_on_held_out)}. No "
        "parameter was fitted to these, but only a further recording (armscope.predict) judges the choice."
    )


def _validated(result: Identification) -> str:
    """The error of model.toml, and whether it is more than noise at the worst joint."""
    fit, held = result.relative_error(False), result.relative_error(True)
    if held != held:
        sentence = f"Relative error of model.toml {fit:.2%} on the fitted runs."
    elif result.held_out == "split":
        sentence = (
            f"Relative error of model.toml {fit:.2%} on the fitted runs, {held:.2%} on the last part of the same runs, "
            "predicted from the first."
        )
    else:
        sentence = f"Relative error of model.toml {fit:.2%} on the fitted runs, {held:.2%} on held-out recordings."
    alone = held != held or result.held_out == "split"
    which = "fitted" if alone else "held-out"
    if above := sorted((one for one in result.noise or () if one.above), key=lambda one: -one.ratio):
        joints = ", ".join(
            f"{_times(one.ratio)} times at joint {one.joint} ({one.error:.2g} {one.unit} against {one.floor:.2g})"
            for one in above
        )
        sentences = (
            f"{sentence} Not validated: while joints move, the error on {which} recordings exceeds the noise floor of "
            f"the instruments, {joints}.",
            without_rotors(result.arm),
            WHAT_IT_LACKS,
        )
        return " ".join(filter(None, sentences))
    if alone:
        return f"{sentence} Not validated: no other recording was held out.{_worst(result, which)}"
    if far := result.joints_above_expected():
        off = ((j, _size(result.rms(True, j, sliding=True), result.torque_unit(j))) for j in far)
        joints = ", ".join(
            f"joint {j + 1} ({size} off, {_size(result.expected_rms(j), '')}expected)" for j, size in off
        )
        return (
            f"{sentence} Not validated at {joints}: the held-out runs contain effects that are not in the model. "
            f"{WHAT_IT_LACKS}"
        )
    if not result.noise:
        return f"{sentence} Not compared with the noise of the instruments."
    judged = "to which no parameter was fitted" if result.chosen_on_held_out else "that were not fitted"
    return f"{sentence} Validated on motions {judged}.{_worst(result, which)}"


def _times(ratio: float) -> str:
    """Two digits, without an exponent."""
    return f"{ratio:.0f}" if ratio >= 100.0 else f"{ratio:.2g}"


def _worst(result: Identification, which: str) -> str:
    """How large the error of the worst joint is; nothing where that is not known."""
    if not result.noise:
        return ""
    worst = max(result.noise, key=lambda one: one.ratio)
    return (
        f" While joints move, the error on {which} recordings is at most {worst.ratio:.2g} times the noise floor of "
        f"the instruments (joint {worst.joint}: {worst.error:.2g} {worst.unit} against {worst.floor:.2g})."
    )


def _errors(result: Identification) -> Markup:
    rows = []
    explained = any(p.prediction_std is not None for p in result.predictions)
    for j in range(len(result.arm)):
        unit = result.torque_unit(j)
        row = [str(j + 1)]
        for held in (False, True):
            row += [_size(result.rms(held, j), unit, 3), _percent(result.relative_error(held, j))]
        if explained:
            row += [_size(size, unit, 3) for size in (result.rms(True, j, sliding=True), result.expected_rms(j))]
        if result.noise and (one := result.noise_of(j)):
            row += [_size(one.error, one.unit, 3), _size(one.floor, one.unit, 3), significant(one.ratio, 2)]
        elif result.noise:
            row += [""] * 3
        rows.append(row)
    head = ["joint", "fitted, rms", "relative", "held out, rms", "relative"]
    head += ["sliding, rms", "expected"] if explained else []
    head += [recorded_quantities(result.arm), "noise floor", "ratio"] if result.noise else []
    return table(rows, head, range(1, len(head)))


def _totals(result: Identification) -> list[str]:
    """Relative errors of all joints together, of model.toml and of what it is compared with."""
    total = {"model.toml": (result.relative_error(False), result.relative_error(True))}
    return [
        f"All joints, {name}: {_percent(fit)} fitted" + (f", {_percent(held)} held out" if held == held else "")
        for name, (fit, held) in (total | result.compared).items()
    ]


def _recordings(result: Identification) -> Markup:
    rows: list[list[str]] = []
    for run in result.runs:
        rows.append([Markup("<b>{}</b>, {} rows of {:.4g} ms").format(run.run, run.rows, run.period * 1e3)])
        for joint in run.joints:
            left_out = ", ".join(f"{reason} {count / run.rows:.0%}" for reason, count in joint.left_out.items())
            rows.append(
                [
                    f"joint {joint.joint}",
                    f"{significant(joint.travel)} {joint.unit}",
                    f"{significant(joint.top_speed)} {joint.unit}/s",
                    f"{joint.used / run.rows:.0%}",
                    left_out,
                    "" if joint.torque is None else f"{joint.torque:.0%} of its limit",
                ]
            )
    return table(
        rows,
        ("", "travel", "top speed", "rows used", "rows excluded", "largest torque"),
        (1, 2, 3, 5),
    )


def _percent(share: float) -> str:
    return "" if share != share else f"{share:.2%}"


def _size(value: float, unit: str, figures: int = 4) -> str:
    return "" if value != value else f"{significant(value, figures)} {unit}"


def _values(values: list[Value], what: str) -> Markup:
    rows = []
    for value in values:
        spreads = [value.std_bootstrap, value.std_formula]
        number, two_std = value_and_two_std(value.value, value.std)
        rows.append(
            [
                value.name,
                number,
                two_std and f"± {two_std}",
                *("" if std is None or std != std else f"{2 * std:.2g}" for std in spreads),
                Markup('<span class="u">{}</span>').format(value.unit),
                Markup("<small>{}</small>").format(value.why),
            ]
        )
    head = (what, "value", "± 2 std", "bootstrap", "formula", "unit", "")
    return table(rows, head, range(1, 5), [k for k, value in enumerate(values) if not value.identifiable])
