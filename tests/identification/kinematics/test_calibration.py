"""The whole procedure on runs: extensions on unseen points, delays and shifted rows, unknown frames."""

from __future__ import annotations

import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_io import InputError
from arm_model.rigid_body.numeric import rigid_torque
from identification.kinematics.data.recordings import gravity_of
from identification.kinematics.data.runs import Run, correlation_time
from identification.kinematics.estimation.calibration import Settings, calibrate
from identification.kinematics.models.parameters import Target
from identification.kinematics.report.write import summary, table_of

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, TARGET, motion, puma, run_of, seen, sweeps, with_errors

SAG = 2e-5


@pytest.fixture(scope="module")
def arms(root: Path):
    nominal = puma(root)
    return nominal, with_errors(nominal, np.random.default_rng(11))


def measured(nominal, true, name: str, seed: int, *, sag: float = 0.0, late: float = 0.0, seconds: float = 12.0) -> Run:
    generator = np.random.default_rng(seed)
    t, q = motion(nominal, seconds, generator)
    link = q.copy()
    if sag:
        link[:, 1] -= sag * rigid_torque(true, q, 0 * q, 0 * q)[:, 1]
    if late:
        link = link - late * np.gradient(q, t, axis=0)
    return run_of(name, t, q, seen(true, link), generator)


def test_geometry_alone_is_left_alone(arms) -> None:
    """An arm with nothing but geometric errors: the noise floor on a held-out run, and no extension invented."""
    nominal, true = arms
    result = calibrate(
        nominal,
        [measured(nominal, true, "a", 1)],
        [measured(nominal, true, "b", 2)],
        [Target(TARGET)],
        Settings(frame_known=True, gravity=gravity_of(nominal)),
    )
    assert result.identifiable == 27
    assert result.extensions == ()
    assert result.shifts == ()
    assert result.after["held_out"].rms < 1.03 * NOISE
    assert result.after["held_out"].rms < 0.02 * result.before["held_out"].rms
    table = table_of(nominal, result)
    assert table["parameters"][1]["beta"] == pytest.approx(
        true.joints[1].beta, abs=6 * table["parameters"][1]["std"]["beta"] + 1e-5
    )
    assert set(table["parameters"][0]) == {"joint", "theta", "alpha", "a", "d", "beta", "std"}
    limits = table["limits"]["extensions"]
    assert (limits["min_gain"], limits["standard_errors"], limits["folds"]) == (0.02, 3.0, 5)


def test_a_model_that_needs_no_calibration_is_said_to_need_none(arms) -> None:
    """It was "calibrated", "-25.31 % better"."""
    nominal, _ = arms
    result = calibrate(
        nominal,
        [measured(nominal, nominal, "a", 1, seconds=3.0)],
        [measured(nominal, nominal, "b", 2, seconds=3.0)],
        [Target(TARGET)],
        Settings(frame_known=True),
    )
    assert any("keep the nominal model" in warning for warning in result.warnings)
    (line,) = [line for line in summary(table_of(nominal, result)).splitlines() if line.startswith("held-out points")]
    assert line.endswith("% worse)")


def test_sag_and_delay_are_found_by_name(arms) -> None:
    nominal, true = arms
    kw = {"sag": SAG, "late": 0.0033}
    result = calibrate(
        nominal,
        [measured(nominal, true, "a", 3, **kw)],
        [measured(nominal, true, "b", 4, **kw)],
        [Target(TARGET)],
        Settings(frame_known=True, gravity=gravity_of(nominal)),
    )
    assert {str(e) for e in result.extensions} == {"link_sag of joint 2", "tracker_latency"}
    value = {e.name: v for e, v in zip(result.extensions, result.fit.extension)}
    assert value["link_sag"] == pytest.approx(SAG, rel=0.05)
    assert value["tracker_latency"] == pytest.approx(0.0033, rel=0.05)
    assert result.after["held_out"].rms < 1.03 * NOISE


@pytest.mark.parametrize(
    ("name", "joint", "by", "wanted"),
    [
        ("encoder_scale", 3, None, [2e-3]),
        ("encoder_eccentricity", 2, None, [6e-4, -8e-4]),
        ("encoder_ovality", 2, None, [5e-4, -4e-4]),
        ("transmission_coupling", 3, 2, [3e-3]),
    ],
)
def test_errors_between_encoder_and_joint_are_found_by_name(arms, name, joint, by, wanted) -> None:
    """A wrong number of lines, an eccentric encoder, and an axis driven through another (a3 with a2).

    Links stand where it puts them.
    """
    nominal, true = arms

    def bent(name_: str, seed: int) -> Run:
        generator = np.random.default_rng(seed)
        t, q = motion(nominal, 12.0, generator)
        link, own = q.copy(), q[:, joint - 1]
        link[:, joint - 1] += {
            "encoder_scale": wanted[0] * own,
            "encoder_eccentricity": wanted[0] * np.sin(own) + wanted[-1] * np.cos(own),
            "encoder_ovality": wanted[0] * np.sin(2.0 * own) + wanted[-1] * np.cos(2.0 * own),
            "transmission_coupling": wanted[0] * q[:, (by or 1) - 1],
        }[name]
        return run_of(name_, t, q, seen(true, link), generator)

    result = calibrate(
        nominal,
        [bent("a", 40)],
        [bent("b", 41)],
        [Target(TARGET)],
        Settings(frame_known=True, gravity=gravity_of(nominal)),
    )
    assert [(e.name, e.joint, e.by) for e in result.extensions] == [(name, joint, by)]
    np.testing.assert_array_less(np.abs(result.fit.extension - wanted), 5 * result.extension_std + 1e-6)
    assert result.after["held_out"].rms < 1.03 * NOISE


@pytest.mark.parametrize("first", [0, 680])
def test_points_of_another_trigger_are_put_back(arms, first: int) -> None:
    nominal, true = arms
    run, judge = measured(nominal, true, "a", 5), measured(nominal, true, "b", 6)
    late = run.xyz.copy()
    late[first + 1 :] = run.xyz[first:-1]
    result = calibrate(nominal, [replace(run, xyz=late)], [judge], [Target(TARGET)], Settings(frame_known=True))
    assert [(s.run, s.rows) for s in result.shifts] == [("a", 1)]
    assert abs(result.shifts[0].first - first) <= 2
    assert result.extensions == ()
    assert result.after["held_out"].rms < 1.03 * NOISE


@pytest.mark.parametrize("frame_known", [True, False])
def test_an_unknown_tracker_frame_is_estimated(arms, frame_known: bool) -> None:
    """Also where the rig file claims that the points are in the base frame and they are not."""
    nominal, true = arms
    turn, shift = Rotation.from_euler("zyx", [2.0, 0.1, -0.3]).as_matrix(), np.array([1.5, -2.0, 0.4])
    runs = [measured(nominal, true, name, seed) for name, seed in (("a", 7), ("b", 8))]
    runs = [replace(run, xyz=(run.xyz - shift) @ turn) for run in runs]  # p_base = turn p_tracker + shift
    result = calibrate(nominal, runs[:1], runs[1:], [Target(TARGET)], Settings(frame_known=frame_known))
    assert not result.frame_known
    assert bool(result.warnings) == frame_known
    pose = np.array(table_of(nominal, result)["tracker_frame"]["base_from_tracker"])
    assert np.degrees(Rotation.from_matrix(pose[:3, :3] @ turn.T).magnitude()) < 3.0
    np.testing.assert_allclose(pose[:3, 3], shift, atol=0.05)  # joint 1 and the base are one to the tracker
    assert result.after["held_out"].rms < 1.03 * NOISE


def test_three_sweeps_give_fifteen_parameters_and_their_circles(arms) -> None:
    nominal, true = arms
    generator = np.random.default_rng(9)
    q = sweeps((1, 2, 3), np.array([0.0, 0.2, 0.5, 0.0, 1.2, 0.0]), 2.0, rows=500)
    run = run_of("sweeps", np.arange(len(q)) * 0.004, q, seen(true, q), generator)
    result = calibrate(nominal, [run], [], [Target(TARGET)], Settings(frame_known=True))
    assert result.identifiable == 15
    assert [c.joint for c in result.circles] == [3, 2, 1]
    assert result.judged_by == "split"
    assert result.after["held_out"].rms < 1.1 * NOISE
    assert result.circle_point is not None
    as_given = np.sqrt(np.mean((run.xyz - seen(nominal, q)) ** 2))
    assert result.after["fit"].rms < result.circle_point.rms < as_given


def test_neighbours_that_say_the_same_are_not_counted_twice() -> None:
    generator = np.random.default_rng(10)
    white = generator.normal(size=(4000, 3))
    assert correlation_time(white, [np.arange(4000)]) < 1.3
    assert correlation_time(np.repeat(white[:400], 10, axis=0), [np.arange(4000)]) == pytest.approx(10.0, rel=0.3)


def test_unusable_runs_are_refused(arms) -> None:
    nominal, true = arms
    run = measured(nominal, true, "a", 1)
    with pytest.raises(InputError, match="at least 10 are needed"):
        calibrate(
            nominal, [replace(run, xyz=np.full_like(run.xyz, np.nan))], [], [Target(TARGET)], Settings(frame_known=True)
        )
    with pytest.raises(InputError, match="has 3 joints, the model has 6"):
        calibrate(nominal, [replace(run, q=run.q[:, :3])], [], [Target(TARGET)], Settings(frame_known=True))
    with pytest.raises(InputError, match="no joint moves"):
        calibrate(nominal, [replace(run, q=np.zeros_like(run.q))], [], [Target(TARGET)], Settings(frame_known=True))


def test_memory_hardly_grows_with_the_rows_of_a_recording(arms) -> None:
    """Beyond the rows themselves: less than two kilobytes a row more were needed for the Jacobian of all of them."""
    nominal, true = arms
    generator, peaks = np.random.default_rng(5), []
    for rows in (8_000, 32_000):
        t, q = motion(nominal, rows / 1000.0, generator, 1000.0)
        run = Run("long", t, q, np.full((len(t), 3), np.nan))
        run.xyz[::20] = seen(true, q[::20]) + generator.normal(size=(len(q[::20]), 3)) * NOISE
        tracemalloc.start()
        calibrate(nominal, [run], [run], [Target(TARGET)], Settings(frame_known=True, extend=False))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 24_000 < 900.0
