"""The demand of an experiment: continuous, within its speeds and accelerations, starting and ending at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_io import InputError
from experiment import Experiment, demand_of, read_experiment, write_experiment


def _experiment(segments: list[dict]) -> Experiment:
    return Experiment.model_validate(
        dict(name="test", start=[0.1, -0.2], full_speed=[1.0, 2.0], full_acceleration=[5.0, 8.0], segment=segments)
    )


@given(
    st.lists(
        st.tuples(st.sampled_from([1, 2]), st.floats(-3, 3), st.floats(0.05, 1.0)),
        min_size=1,
        max_size=5,
    )
)
def test_drives_keep_speed_and_acceleration_and_reach_their_target(drives: list[tuple[int, float, float]]) -> None:
    experiment = _experiment([dict(type="drive", joint=j, to=q, speed=v) for j, q, v in drives])
    demand = demand_of(experiment)
    step = 1e-3
    t = np.arange(0, demand.duration + step, step)
    q = demand(t)
    speed = np.abs(np.diff(q, axis=0)) / step
    assert np.all(speed <= np.array([1.0, 2.0]) * (1 + 1e-9))
    assert np.all(np.abs(np.diff(q, 2, axis=0)) / step**2 <= np.array([5.0, 8.0]) * (1 + 1e-6))
    last = {j: q for j, q, _ in drives}
    for joint, target in last.items():
        assert demand.end[joint - 1] == target
    np.testing.assert_array_equal(demand(np.array([demand.duration + 1.0]))[0], demand.end)


def test_move_ends_all_joints_together() -> None:
    demand = demand_of(_experiment([dict(type="move", to=[1.1, 0.8])]))
    share = (demand(np.linspace(0, demand.duration, 50)) - [0.1, -0.2]) / [1.0, 1.0]
    np.testing.assert_allclose(share[:, 0], share[:, 1], atol=1e-12)


def test_fourier_starts_and_ends_at_rest() -> None:
    segment = dict(
        type="fourier", duration=4.0, fundamental=0.5, sine=[[0.1, 0.2], [0.3, 0.0]], cosine=[[0, 0.1], [0.2, 0]]
    )
    demand = demand_of(_experiment([segment]))
    edge = demand(np.array([0.0, 1e-4, 4.0 - 1e-4, 4.0]))
    np.testing.assert_allclose(edge, np.tile([0.1, -0.2], (4, 1)), atol=1e-8)


def test_repeat_is_the_segments_over_again() -> None:
    inner = [dict(type="drive", joint=1, by=0.5), dict(type="drive", joint=1, by=-0.5)]
    repeated = demand_of(_experiment([dict(type="repeat", times=3, segment=inner)]))
    written_out = demand_of(_experiment(inner * 3))
    t = np.linspace(0, repeated.duration, 400)
    np.testing.assert_allclose(repeated(t), written_out(t), atol=1e-13)


def test_file_round_trip(tmp_path: Path) -> None:
    experiment = _experiment([dict(type="hold", duration=0.5), dict(type="drive", joint=2, to=1.0, speed=0.5)])
    write_experiment(tmp_path / "e.toml", experiment, heading="a test")
    assert read_experiment(tmp_path / "e.toml") == experiment


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([dict(type="drive", joint=3, to=1.0)], "joint: 3 is not in 1..2"),
        ([dict(type="drive", joint=1)], "either 'to'"),
        ([dict(type="move", to=[1.0])], "has 1 entries, needs 2"),
        ([dict(type="drive", joint=1, to=1.0, speed=2.0)], "less than or equal to 1"),
        ([dict(type="hold", duration=0.1, hold=1)], "unknown entry"),
        ([], "at least 1 item"),
    ],
)
def test_wrong_files_say_where_and_what(segments: list[dict], words: str, tmp_path: Path) -> None:
    import tomli_w

    table = dict(name="x", start=[0, 0], full_speed=[1, 1], full_acceleration=[1, 1], segment=segments)
    (tmp_path / "e.toml").write_text(tomli_w.dumps(table))
    with pytest.raises(InputError, match="e.toml") as caught:
        read_experiment(tmp_path / "e.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
