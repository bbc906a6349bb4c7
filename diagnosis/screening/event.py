"""An effect that is an event or a spectral line in raw rows: removed from the recordings before the rest is judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from diagnosis.cause import EncoderJump, Estimate, LostRows


@dataclass(frozen=True, kw_only=True)
class Gain:
    """The residual that an event explains, where it shows.

    Rms of that error without and with it, in ``unit``, at ``joint`` (from 1), and the probability that the fall is
    chance.
    """

    before: float
    after: float
    unit: str
    joint: int
    p: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Event:
    """An effect found in raw rows.

    joint       from 1; None: of the whole arm
    recordings  those that show it, by index
    gain        what it explains there; None: it shows in closed loop only
    of_joints   of an event of the whole arm that shows joint by joint: its parameters at each joint (from 1)
    lost_rows   of dropped triggers: every loss
    encoder_jumps  of an encoder: every jump
    """

    effect: str
    joint: int | None
    parameters: list[Estimate]
    evidence: str
    recordings: tuple[int, ...]
    gain: Gain | None = None
    of_joints: Mapping[int, list[Estimate]] = field(default_factory=dict)
    lost_rows: tuple[LostRows, ...] = ()
    encoder_jumps: tuple[EncoderJump, ...] = ()


def united(events: Sequence[Event]) -> list[Event]:
    """The events with those of one effect at one joint (or of the arm) united.

    Parameters are those of the first with that effect; evidence, recordings and lost rows are those of all.
    """
    of_key: dict[tuple[str, int | None], Event] = {}
    for event in events:
        key = event.effect, event.joint
        first = of_key.get(key)
        if first is None:
            of_key[key] = event
            continue
        gains = [e.gain for e in (first, event) if e.gain is not None]
        of_key[key] = replace(
            first,
            evidence=f"{first.evidence}; {event.evidence}",
            recordings=tuple(sorted({*first.recordings, *event.recordings})),
            gain=max(gains, key=lambda gain: gain.before - gain.after, default=None),
            of_joints={**event.of_joints, **first.of_joints},
            lost_rows=(*first.lost_rows, *event.lost_rows),
            encoder_jumps=(*first.encoder_jumps, *event.encoder_jumps),
        )
    return list(of_key.values())
