"""Thesis, section 5.3: one joint at a time with the others not blocked.

Wrong values, their cause, and how they become right.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from examples.coupling import main


@pytest.mark.slow
def test_coupling_torque_is_what_a_motor_link_pair_takes_for_friction(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = main(tmp_path)
    for joint in ("joint2", "joint3"):
        values = figures[joint]["values"]
        assert min(values[name]["others moving"] for name in ("coulomb_positive", "coulomb_negative")) < 0.0
        assert figures[joint]["coupling_share"] > 0.95
        for name in ("viscous", "coulomb_positive", "coulomb_negative"):
            row = values[name]
            wrong, right = (abs(row[way] - row["true"]) for way in ("others moving", "coupling taken out"))
            assert right < 0.2 * abs(row["true"]) and right < 0.3 * wrong
            assert row["whole arm"] == pytest.approx(row["true"], rel=0.03)
    felt = figures["joint2"]["coupling_rms_by_joint"]
    assert felt[3] > 3 * max(felt[k] for k in (4, 5, 6))
    assert "coupling torque of the other links" in capsys.readouterr().out
