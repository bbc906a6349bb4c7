"""Causes that the joint fit found, if each explains several changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm_report.numbers import with_two_std
from comparison.change import Change
from comparison.joint_fit.fewest_changes import AcceptedChange
from comparison.joint_fit.tested import Tested
from comparison.summary import SIGNIFICANT_STDS, Summary, of_significant


def summaries_of_joint_fit(found: Sequence[AcceptedChange], significant: Sequence[Change]) -> Iterator[Summary]:
    """The causes among what the joint fit found that make several changes: scales, bodies, effects beyond the model."""
    of = [each.quantity for each in significant]
    for one in found:
        tested, joint = one.tested, one.tested.hypothesis.joint
        what, added = tested.hypothesis.what, tested.hypothesis.added
        if joint is None:
            names = [each.name for each in of if added is not None and each.name.startswith(f"{added.effect}.")]
            if added is not None and names:
                yield (_skew if added.timed else _tilt)(tested, names, len(of))
        elif what == "scale":
            names = [each.name for each in of if each.name in one.quantities or each.joint == joint]
            if (summary := current_scale(joint, tested, names, len(of) - len(names))) is not None:
                yield summary
        elif added is not None:
            own = [each for each in of if each.name.startswith(f"joint{joint}.{added.effect}.")]
            names = [each.name for each in of if each in own or each.name in one.quantities]
            if own and len(names) > len(own):
                yield _cause(added.effect, joint, own[0].words, names, len(of))
        elif what == "inertia" and len(tested.coefficients) > 1:
            names = [each.name for each in of if each.name in one.quantities]
            if len(names) > 1:
                yield _cause("link_inertia", joint, f"body of link {joint}, or what it carries", names, len(of))


def _tilt(tested: Tested, explains: Sequence[str], of: int) -> Summary:
    """Another tilt of the base."""
    values, stds = tested.seen_by(tested.hypothesis.directions.T)
    roll, pitch = ((float(value), float(std), "rad") for value, std in zip(values, stds))
    size = float(np.hypot(*values))
    std = float(np.hypot(*(values * stds))) / max(size, 1e-300)
    shown = f"{with_two_std(1e3 * size, 1e3 * std)} mrad (roll {1e3 * values[0]:.3g}, pitch {1e3 * values[1]:.3g})"
    sentence = f"Base tilted by {shown}: explains {of_significant(len(explains), of)}"
    return Summary(
        effect="base_tilt",
        joint=None,
        parameters={"roll": roll, "pitch": pitch},
        explains=tuple(explains),
        sentence=sentence,
    )


def _skew(tested: Tested, explains: Sequence[str], of: int) -> Summary:
    """Another delay between currents and angles."""
    (delay,), (std,) = tested.seen_by(tested.hypothesis.directions.T)
    when = "later" if delay > 0.0 else "earlier"
    return Summary(
        effect="time_skew",
        joint=None,
        parameters={"delay": (float(delay), float(std), "s")},
        explains=tuple(explains),
        sentence=(
            f"Currents are read {with_two_std(1e3 * abs(delay), 1e3 * std)} ms {when} than before, relative to the "
            f"angles: explains {of_significant(len(explains), of)}"
        ),
    )


def _cause(effect: str, joint: int, words: str, explains: Sequence[str], of: int) -> Summary:
    """A cause whose value the table has."""
    sentence = f"{words[:1].upper()}{words[1:]}: explains {of_significant(len(explains), of)}"
    return Summary(effect=effect, joint=joint, parameters={}, explains=tuple(explains), sentence=sentence)


def current_scale(joint: int, tested: Tested, explains: Sequence[str], others: int) -> Summary | None:
    """Another scale of the currents of a joint (from 1) as the joint fit has it."""
    unit = tested.hypothesis.directions.T
    (scale,), (std,) = tested.seen_by(unit)
    return scaled_currents(joint, float(scale), float(std), explains, others)


def scaled_currents(joint: int, scale: float, std: float, explains: Sequence[str], others: int) -> Summary | None:
    """Another scale of the currents of a joint (from 1), relative to those before."""
    if abs(scale) < SIGNIFICANT_STDS * std:
        return None
    constant = 1.0 / (1.0 + scale) - 1.0
    digits = max(0, 1 - int(np.floor(np.log10(max(200 * std, 1e-3)))))
    return Summary(
        effect="torque_constant",
        joint=joint,
        parameters={"error": (constant, std / (1.0 + scale) ** 2, "1")},
        explains=tuple(explains),
        sentence=(
            f"Currents of joint {joint} are {100 * scale:+.{digits}f} +- {200 * std:.{digits}f} % for the same torque "
            f"(torque constant {100 * constant:+.{digits}f} %, or the gain of its transducer): explains "
            f"{of_significant(len(explains), len(explains) + others)}"
        ),
    )
