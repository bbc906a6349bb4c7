"""What a diagnosis says beside its causes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from diagnosis import diagnose
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day


def test_a_model_without_friction_is_to_be_identified_first(tmp_path: Path, root: Path) -> None:
    """As URDF files give it: of a six-axis arm sixteen causes were named, and a cold arm as their likeliest origin."""
    fit, held_out = (two_link.recorded(tmp_path / f"{seed}.mcap", seed, Day()) for seed in (1, 2))
    known = two_link.model(root)
    bare = replace(known, joints=tuple(replace(j, viscous=(0.0, 0.0), coulomb=(0.0, 0.0)) for j in known.joints))
    assert not any("no friction" in one for one in diagnose(known, [fit], [held_out]).warnings)
    result = diagnose(bare, [fit], [held_out])
    assert {cause.effect for cause in result.causes} == {"viscous_friction", "coulomb_friction"}
    (warning,) = (one for one in result.warnings if "no friction" in one)
    assert "identify the arm first" in warning
