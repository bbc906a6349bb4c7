"""A diagnosis in words: the verdict, names of causes, numbers with their uncertainty.

The report, the terminal and the questions before an experiment on a rig share these sentences.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_report.numbers import numbered, value_and_two_std
from diagnosis.cause import Cause, EncoderJump, Estimate, LostRows, Signal, in_words
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.cause.units import readable, rounded, variable_in_words
from diagnosis.closed_loop.comparison import FAITHFUL, simulated_behind
from diagnosis.report.joint_verdicts import Remaining, remaining
from diagnosis.result import Diagnosis
from identification import recorded_quantity, recorded_signals

SURE = 0.9
"""Confidence below which the verdict states it: of such names of the bank 15 of 26 were right, of others 269 of 271."""
MOSTLY = 0.8
"""Share of the squares of a closed loop's position error from which it is called a delay."""


def title(cause: Cause) -> str:
    """``backlash of joint 2``."""
    return in_words((cause.effect, cause.joint))


def either(cause: Cause) -> str:
    """A cause with the rest of its ambiguity group: ``torque constant or current gain of joint 2``."""
    if cause.of_recordings and not cause.of_arm and cause.signal is Signal.CURRENT:
        return f"{_either(cause)} ({differing(cause)})"
    return _either(cause)


def differing(cause: Cause) -> str:
    """``mass 3.0 kg in A.mcap, 2.8 kg in B.mcap: mounted differently``, of its first parameter."""
    firsts = [(name, own[0]) for name, own in cause.of_recordings.items()]
    sizes = [f"{figures(one)[0]}{'' if one.unit == '1' else f' {one.unit}'} in {name}" for name, one in firsts]
    why = CATALOGUE[cause.effect].settable or "not the same in all recordings"
    return f"{firsts[0][1].name.replace('_', ' ')} {', '.join(sizes)}: {why}"


def _either(cause: Cause) -> str:
    if len({joint for _, joint in cause.group}) > 1:
        return " or ".join(map(in_words, cause.group))
    names = " or ".join(in_words((effect, None)) for effect, _ in cause.group)
    terms = f" with {' and '.join(cause.next_orders)}" if cause.next_orders else ""
    return (f"{names} of joint {cause.joint}" if cause.joint else names) + terms


def sentence(result: Diagnosis) -> str:
    """The verdict in words."""
    judged = _judged(result)
    if result.shortage is None:
        return " ".join(part for part in (judged, _left_over(result), _loop_not_judged(result)) if part)
    short = f"Too short to judge: {result.shortage}."
    return short if judged.startswith("Consistent") else f"{judged} {short}"


def _left_over(result: Diagnosis) -> str:
    """Sentences on the remaining residual: the joints above the noise, and what would decide there."""
    joints = [one for one in remaining(result) if any(one.words)]
    if joints:
        above = [words for one in joints for words in one.words]
        return " ".join([f"Above the noise: {', '.join(above)}.", *deciding(joints)])
    return "The residual is noise." if result.verdict == "explained" and not result.warnings else ""


def _loop_not_judged(result: Diagnosis) -> str:
    """That the closed loop says nothing, where the simulated servos are not those of the arm; else empty."""
    pairs = result.closed_loops.held_out if result.judged else []
    if not pairs or result.in_closed_loop:
        return ""
    off = np.sqrt(np.mean([after.error_rms("angle") ** 2 for _, after in pairs], axis=0))
    joint = int(np.argmax(off)) + 1
    factor, unit = readable(result.arm.joints[joint - 1].unit("rad"), (off[joint - 1],))
    delay, share = simulated_behind([after for _, after in pairs], joint)
    behind = "behind" if delay > 0.0 else "ahead"
    late, least = ("late", "less") if delay > 0.0 else ("early", "more")
    why = (
        f" Most of it is a delay: the simulation is {rounded(1e3 * abs(delay), 2)} ms {behind}, "
        f"as if the demands had been recorded so much too {late}, or the servos of the arm lagged {least}."
    )
    return (
        f"The closed loop was not judged: its positions of joint {joint} are {rounded(factor * off[joint - 1], 2)} "
        f"{unit} rms off, more than the model errs along the measured motion. Its controller is not that of this arm, "
        f"or a servo has changed.{why if share > MOSTLY else ''}"
    )


def deciding(joints: Sequence[Remaining]) -> Iterator[str]:
    """What would decide whether a joint above the noise, but within the uncertainty of the model, has changed.

    An error of the model is also in recordings of the day of its identification, and cancels when both days are
    compared. An uncertainty that comes from noise becomes smaller with more recordings. Neither decides
    what exceeds it.
    """
    known = [joint for joint in joints if joint.known_to and joint.verdict != "unexplained"]
    lacking = [one.joint for one in known if one.by_lack]
    unsure = [one.joint for one in known if not one.by_lack]
    if lacking:
        yield (
            f"To decide at {_joints(lacking)}: repeat an experiment of the model's identification and compare both "
            "recordings (armscope compare); an error of the model is the same in both."
        )
    if unsure:
        yield (
            f"To decide at {_joints(unsure)}: identify from more recordings; the parameters of the model are not known "
            "well enough."
        )
    if beyond := [one.joint for one in joints if one.known_to and one.verdict == "unexplained"]:
        yield (
            f"At {_joints(beyond)} it is more than the uncertainty of the model explains. If these recordings are of "
            "another day than those of the model's identification, armscope compare of both says which quantities "
            "changed, friction speed by speed."
        )


def _joints(numbers: Sequence[int]) -> str:
    return numbered("joint", numbers)


def _judged(result: Diagnosis) -> str:
    """The verdict on what could be judged."""
    # above the noise, but not above what is known of an identified model
    known = (
        ", as far as the model is known" if any(one.known_to and any(one.words) for one in remaining(result)) else ""
    )
    if result.verdict == "consistent":
        return f"Consistent{known}: no effect and no structure was found in these recordings."
    grouped = any(len(cause.group) > 1 for cause in result.causes)
    causes = ("; " if grouped else ", ").join(f"{either(one)}{_doubted(one)}" for one in result.causes)
    if result.verdict == "explained":
        return f"Explained{known}: {causes}."
    places = ", ".join(against(result.arm, one.signal, one.joint, one.words()) for one in result.unexplained)
    structure = f"structure in {places} that no effect of the catalogue explains."
    return f"Explained in part: {causes}. There remains {structure}" if causes else f"Unexplained: {structure}"


def _doubted(cause: Cause) -> str:
    """`` (confidence 64%)``, of a name whose confidence is less than ``SURE``; else empty."""
    return f" (confidence {cause.confidence:.0%})" if cause.confidence < SURE else ""


def place(arm: Arm, signal: str, joint: int | None) -> str:
    """``the current of joint 2``, or its torque or force, where recordings have that."""
    if not joint:
        return f"the {signal}'s points"
    quantity = recorded_quantity(arm.joints[joint - 1])
    quantity = {Signal.CLOSED_LOOP: f"{quantity} in closed loop", Signal.CURRENT: quantity}.get(Signal(signal), signal)
    return f"the {quantity} of joint {joint}"


def against(arm: Arm, signal: str, joint: int | None, variable: str) -> str:
    """``the current of joint 2 against position``; or that no single variable predicts it."""
    words = variable_in_words(variable, arm, joint)
    return f"{place(arm, signal, joint)}{', ' if variable.startswith('no ') else ' against '}{words}"


def estimate(one: Estimate) -> str:
    """``half gap 0.001021 ± 0.000007 rad``: two std, and no more digits than these determine.

    Of friction, its share of the model's own: ``coulomb 2.35 ± 0.1 N m (+47 % of the model's own)``.
    """
    unit = "" if one.unit == "1" else f" {one.unit}"
    number, two_std = figures(one)
    about = f" ± {two_std}" if two_std else ""
    share = "" if one.of_own is None else f" ({100 * one.of_own:+z.0f} % of the model's own)"
    return f"{one.name.replace('_', ' ')} {number}{about}{unit}{share}"


def remainder(cause: Cause) -> str:
    """``beside it, 14 % of its excess is unexplained, against position``; empty where nothing is."""
    if cause.remainder is None:
        return ""
    variables = [name for name in cause.remainder.against if name != NO_VARIABLE]
    depends = f", against {' and '.join(variables)}" if variables else f", against {NO_VARIABLE}"
    return f"beside it, {100 * cause.remainder.share:.0f} % of its excess is unexplained{depends}"


def rise_at_rest(cause: Cause) -> str:
    """``its level rises by 0.5 ± 0.1 N m for ten times the time at rest``, or why that is not known; or empty."""
    rise = cause.rise_at_rest
    if rise is None:
        return ""
    if rise.value is None or rise.std is None:
        seen = f"{rise.rests} rests" + (f" of {rise.shortest:.2g} to {rise.longest:.2g} s" if rise.rests else "")
        return (
            f"whether its level rises with the time at rest is not known ({seen} before a slow start); rests of 0.2, 1 "
            "and 5 s, several of each, before slow moves would show it"
        )
    over = f"(std {rounded(rise.std, 2)}; {rise.rests} rests of {rise.shortest:.2g} to {rise.longest:.2g} s)"
    if not rise.determined:
        largest = max(rise.value, 0.0) + 2 * rise.std
        return f"its level rises by less than {rounded(largest, 2)} {rise.unit} for ten times the time at rest {over}"
    return f"its level rises by {rounded(rise.value, 3)} {rise.unit} for ten times the time at rest {over}"


def comparison(arm: Arm, looped: bool, faithful: bool) -> str:
    """How measurement and simulation were compared.

    looped: whether there are closed loops on held-out recordings; faithful: whether these follow the recordings as well
    as the model follows the measured motion.
    """
    signals = recorded_signals(arm)
    along = f"The {signals} of the table are those that the model predicts along the measured motion."
    if looped and faithful:
        return (
            "Model and arm were given the same demands. Noise is that of the residual along the measured motion, which "
            "contains encoder quantisation differentiated twice; the closed loop contains none, so its error may be "
            "smaller."
        )
    if looped:
        return (
            f"Model and arm were given the same demands. At a joint at least, the {signals} of this closed loop are "
            f"more than {FAITHFUL} times as far from the measured ones as those predicted along the measured motion: "
            "the controller of the model is not that of this arm, or a servo has changed. The pictures and the "
            "position errors show mostly the difference between both controllers, and neither confirm nor refute a "
            f"cause. {along}"
        )
    if arm.controller is None:
        return f"No closed-loop simulation: the model has no controller. {along}"
    return (
        "No closed-loop simulation: the held-out recordings have no demands, or the loop is unstable with the "
        f"controller of the model. {along}"
    )


def values_of(cause: Cause) -> list[str]:
    """One line per parameter, per joint of a cause of the rig, or per recording where they contradict each other.

    Of lost rows: one line per loss; of missed counts, one line per jump where there are several.
    """
    if cause.lost_rows:
        return [_lost(one) for one in cause.lost_rows]
    if len(cause.encoder_jumps) > 1:
        return [_missed(one) for one in cause.encoder_jumps]
    by_place = {f"at joint {joint}": values for joint, values in cause.of_joints.items()}
    by_place |= {f"in {name}": values for name, values in cause.of_recordings.items()}
    relative = {parameter.name: parameter for parameter in CATALOGUE[cause.effect].parameters if parameter.own}

    def words(one: Estimate) -> str:
        return relative[one.name].in_words(one.value, one.unit) if one.name in relative else estimate(one)

    if not by_place:
        return [words(p) for p in cause.parameters]
    return [f"{where}: {', '.join(map(words, values))}" for where, values in by_place.items()]


def _lost(one: LostRows) -> str:
    """``counter of joint 2: 12 rows before row 2500 (2.500 s) of a.mcap``; a row with two std where it has some."""
    channels = "drive signals" if one.count > 0 else f"counter of joint {one.joint}" if one.joint else "all counters"
    row = f"{one.row} ± {rounded(2 * one.row_std, 2)}" if one.row_std > 0.0 else f"{one.row}"
    return f"{channels}: {abs(one.count)} rows before row {row} ({one.time:.3f} s) of {one.file}"


def _missed(one: EncoderJump) -> str:
    """``27 ± 2 counts lost before row 5000 (5.000 s) of a.mcap``."""
    number, fate = f"{abs(one.counts)} ± {rounded(2 * one.std, 2)}", "lost" if one.counts < 0 else "gained"
    return f"{number} counts {fate} before row {one.row} ({one.time:.3f} s) of {one.file}"


def figures(one: Estimate) -> tuple[str, str]:
    """A value and two standard deviations, to the same decimal place; "" for a whole number that was chosen."""
    return value_and_two_std(one.value, one.std if one.std > 0.0 else None)


def remains(cause: Cause) -> str:
    """How much of a cause's significance remains with the parameters of the model free; empty for an exact model."""
    if cause.deviations is None:
        return ""
    exact, uncertain = cause.deviations
    return f"{uncertain:.1f} standard deviations from zero ({exact:.1f} if the model were exact)"


def gain(cause: Cause) -> str:
    """``0.154 -> 0.0042 A``, before and after."""
    factor, unit = readable(cause.unit, (cause.before, cause.after))
    return f"{rounded(cause.before * factor)} -> {rounded(cause.after * factor, 2)} {unit}"
