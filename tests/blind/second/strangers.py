"""Defects that the vocabulary has no name for: nothing may be named, and the rest is to be called unexplained."""

from __future__ import annotations

from collections.abc import Mapping

from tests.blind.second.effects import Kind, World, _set
from tests.blind.second.plant import Plant
from tests.blind.second.sensing import Sensing, changed, with_joint


def _cable(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return p._replace(spring=with_joint(p.spring, j, [0.0, v["rest_angle"], v["hardening"]])), s


def _drift(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return p, changed(s, drift=with_joint(s.drift, j, v["drift"]))


STRANGERS: dict[str, Kind] = {
    "limit_cycle": Kind(
        lambda r, p, j, m: {"amplitude": 0.05 * m, "frequency": r.uniform(4.0, 9.0)},
        _set("hunting", "amplitude", "frequency"),
        most=20.0,
    ),
    "magnet_hysteresis": Kind(
        lambda r, p, j, m: {"torque": 0.03 * m * p.drive[j - 1], "order": float(r.integers(3, 9))},
        _set("core", "torque", "order"),
    ),
    "cubic_cable": Kind(lambda r, p, j, m: {"hardening": m * 1.5, "rest_angle": r.uniform(-0.2, 0.2)}, _cable, (1, 2)),
    "drifting_signal": Kind(lambda r, p, j, m: {"drift": 0.04 * m}, _drift),
    "ringing_tripod": Kind(
        lambda r, p, j, m: {"size": 1e-4 * m, "frequency": r.uniform(4.0, 12.0)},
        lambda p, s, j, v: (p, changed(s, ring=(v["size"], v["frequency"]))),
        (),
        "points",
        most=30.0,
    ),
}

VARIABLES: dict[str, list[str]] = {
    "limit_cycle": ["time", "a wave", "velocity", "current", "no single variable"],
    "magnet_hysteresis": ["motor angle", "position", "current", "velocity", "direction"],
    "cubic_cable": ["position", "load"],
    "drifting_signal": ["time"],
    "ringing_tripod": ["time", "a wave"],
}
"""Of which one is the right answer to: against what?"""
