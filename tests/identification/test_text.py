"""An identification as text: a long sum ends after a whole term, and says how many more there are."""

from __future__ import annotations

import pytest

from arm_report.numbers import WIDEST, shortened


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("joint1.coulomb", "joint1.coulomb"),
        ("link5.my + 8.64304 link5.iyz", "link5.my + 8.64304 link5.iyz"),
        (
            "joint1.rotor_inertia + link1.izz + 0.0488149 link2.mass + link2.ixx - link3.iyy",
            "joint1.rotor_inertia + link1.izz and 3 more terms",
        ),
        (
            "link5.izz - link4.iyy - link5.ixx - 0.0133865 link6.mass - link6.izz",
            "link5.izz - link4.iyy - link5.ixx and 2 more terms",
        ),
    ],
)
def test_a_sum_is_cut_between_terms(name: str, printed: str) -> None:
    assert shortened(name) == printed and len(printed) <= WIDEST
