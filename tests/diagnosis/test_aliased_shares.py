"""What a model left along an effect when it was identified is what the effect may explain on another day.

Residuals of an arm that shares no effect code (``tests.diagnosis.two_link``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm
from diagnosis.measurements.currents.model_errors import ALIASED_SHARE
from diagnosis.remainder.aliased_shares import aliased_shares
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day, residual_of

SEEDS = (20, 21, 22)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def test_an_effect_may_explain_what_it_explained_and_others_what_few_recordings_show(arm: Arm) -> None:
    """Friction of joint 1 in one direction that the model lacks, beside friction that waves, which is no effect."""
    runs = [residual_of(arm, seed, Day(positive=(3.0, 0.0), ripple=0.05)) for seed in SEEDS]
    left = [DRIVE * float(np.sqrt(np.mean([np.mean(run.residual[:, j] ** 2) for run in runs]))) for j in range(2)]
    shares = aliased_shares(arm, runs, left)
    least = ALIASED_SHARE / (1 + len(SEEDS))
    assert shares["joint1.current_offset"] > 0.2 > ALIASED_SHARE > shares["joint2.current_offset"] > least


def test_an_effect_of_all_joints_is_known_by_the_errors_of_all(arm: Arm) -> None:
    runs = [residual_of(arm, seed, Day(ripple=0.05)) for seed in SEEDS]
    shares, one_joint = aliased_shares(arm, runs, [0.36, 0.29]), aliased_shares(arm, runs, [0.0, 0.29])
    assert shares["time_skew"] < ALIASED_SHARE / (1 + len(SEEDS)) < one_joint["time_skew"]


def test_a_joint_of_which_noise_is_left_says_nothing_of_an_effect(arm: Arm) -> None:
    runs = [residual_of(arm, seed, Day(ripple=0.05)) for seed in SEEDS]
    shares = aliased_shares(arm, runs, [0.0, 0.29])
    assert "joint1.current_offset" not in shares and shares["joint2.current_offset"] < ALIASED_SHARE
    noisy = [residual_of(arm, seed, Day()) for seed in SEEDS]
    assert aliased_shares(arm, noisy, [1e-4, 1e-4])["time_skew"] == pytest.approx(ALIASED_SHARE, rel=0.01)
