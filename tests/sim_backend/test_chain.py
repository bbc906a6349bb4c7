"""The rig files of the simulated Puma through the real sampler: what comes out is what the arm did."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from arm_model.simulation.simulation import simulate_at
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.rows import Rows
from daq.rig.bench import open_bench
from daq.rig.rig_file import Rig, read_rig
from drivers.protocols import Quality
from experiment import Experiment, demand_of
from sim_backend.rig import world_of
from tests.daq.benches import joined
from tests.sim_backend.recordings import fast_rig

FULL_SPEED = [1.8, 1.4, 2.2, 5.0, 5.0, 5.0]


def _experiment(**changes: object) -> Experiment:
    """All six joints at once, there and half the way back."""
    table = {
        "name": "there and back",
        "start": [0.0, -1.5, 1.5, 0.0, 0.5, 0.0],
        "full_speed": FULL_SPEED,
        "full_acceleration": [6.0, 6.0, 8.0, 20.0, 20.0, 20.0],
        "segment": [
            {"type": "hold", "duration": 0.2},
            {"type": "move", "to": [1.0, -0.5, 0.8, 1.0, -0.5, 1.0], "speed": 0.8},
            {"type": "move", "to": [0.5, -1.0, 1.2, 0.5, 0.0, 0.5], "speed": 0.5},
        ],
    }
    return Experiment.model_validate(table | changes)


def _fast(root: Path, name: str = "puma560_sim", **simulation: object) -> Rig:
    return fast_rig(root / f"config/{name}.toml", **simulation)


def _record(rig: Rig, experiment: Experiment) -> tuple[Rows, Acquisition]:
    with open_bench(rig) as bench:
        acquisition = Acquisition(bench, experiment)
        return joined(list(acquisition.rows())), acquisition


@pytest.fixture(scope="module")
def run(root: Path) -> tuple[Rows, Acquisition]:
    return _record(_fast(root), _experiment())


def test_nothing_is_lost(run: tuple[Rows, Acquisition]) -> None:
    rows, acquisition = run
    assert str(acquisition.ending) == "the motion has ended" and acquisition.notes == []
    summary = acquisition.ledger.summary()
    assert summary.lost == 0 and summary.triggers == len(rows) and (rows.number == np.arange(len(rows))).all()
    assert np.allclose(np.diff(rows.host_ns), 1e6, atol=5e4)


def test_positions_currents_and_points_are_those_of_the_same_simulation(
    run: tuple[Rows, Acquisition], root: Path
) -> None:
    rows, _ = run
    arm = read_model(root / "config/models/puma560.toml")
    demand = demand_of(_experiment())
    t = (1 + rows.number) * 1e-3
    motion = simulate_at(arm, demand, np.append(0.0, t))
    counts_per_radian = np.array([abs(j.gear) * j.encoder_lines * 4 / (2 * np.pi) for j in arm.joints])
    assert (np.abs(rows.q - motion.qm[1:]) * counts_per_radian).max() < 1.6, "half a count of zero, one of reading"
    for joint, turns in enumerate((10, 10, 10, 20, 20, 20)):
        converted = np.append(0.0, t + joint / 83.3e3)
        late = simulate_at(arm, demand, converted).current[1:, joint]
        error = rows.i[:, joint] - late
        spread = 20 / turns * np.sqrt((20 / 4096) ** 2 / 12 + 0.003**2 + 0.001**2)  # converter's step, noise of both
        assert abs(error.mean()) < 0.1 * spread and error.std() == pytest.approx(spread, rel=0.1)
    frame = link_frames(arm, motion.q[1:])[:, -1]
    target = frame[:, :3, :3] @ [0.05, 0.0, 0.10] + frame[:, :3, 3]
    base_from_tracker = np.array(read_rig(root / "config/puma560_sim.toml", drivers=False).tracker.base_from_tracker)
    assert rows.points is not None
    there = ~np.isnan(rows.points[:, 0])
    assert there[::3].all() and there.sum() == len(there[::3])
    assert (rows.quality[~there, -1] == Quality.MISSING).all()
    points = rows.points[there] @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3]
    assert np.sqrt(((points - target[there]) ** 2).sum(axis=1).mean()) == pytest.approx(1e-4, rel=0.1)


def test_same_seed_same_samples_at_either_pace(root: Path) -> None:
    experiment = _experiment(segment=[{"type": "drive", "joint": 4, "to": 0.4}], start=[0.0] * 6)
    fast, _ = _record(_fast(root), experiment)
    wall = read_rig(root / "config/puma560_sim.toml")
    real, acquisition = _record(wall, experiment)
    rows = min(len(fast), len(real))
    assert rows > 400 and acquisition.ledger.summary().lost == 0
    assert (fast.counts[:rows] == real.counts[:rows]).all()
    assert (fast.volts[:rows] == real.volts[:rows]).all()
    assert np.array_equal(fast.points[:rows], real.points[:rows], equal_nan=True)


def test_twenty_kilohertz_on_the_timer_with_the_tracker_on_its_own_clock(root: Path) -> None:
    experiment = _experiment(segment=[{"type": "drive", "joint": 1, "to": 0.4}], start=[0.0] * 6)
    rows, acquisition = _record(_fast(root, "puma560_sim_20khz"), experiment)
    assert acquisition.ledger.summary().lost == 0 and len(rows) > 10_000
    assert np.allclose(np.diff(rows.host_ns), 5e4, atol=4e4)
    fresh = rows.quality[:, -1] == 0
    assert rows.points is not None and abs(fresh.mean() - 0.05) < 0.002
    arm = read_model(root / "config/models/puma560.toml")
    frame = link_frames(arm, np.column_stack([rows.q[fresh][:, :3], np.zeros((fresh.sum(), 3))]))[:, -1]
    target = frame[:, :3, :3] @ [0.05, 0.0, 0.10] + frame[:, :3, 3]
    assert np.abs(rows.points[fresh] - target).max() < 2e-3, "a wrist that sags under its servos, and encoder steps"


def test_looking_moves_nothing(root: Path) -> None:
    """Neither at first, nor after a run whose experiment the controller still has."""
    with open_bench(_fast(root)) as bench:
        first = joined(list(Acquisition(bench, seconds=0.5).rows()))
        list(Acquisition(bench, _experiment()).rows())
        second = joined(list(Acquisition(bench, seconds=0.5).rows()))
    assert len(first) == len(second) == 500
    for rows, settling in ((first, 1), (second, 10)):  # counts; servos still settle after a motion
        assert np.ptp(rows.counts, axis=0).max() <= settling and rows.qref is None


def test_payload_and_drives_off_are_carried_out(root: Path) -> None:
    hold = [{"type": "hold", "duration": 0.5}]
    still = {"segment": hold, "start": [0.0] * 6}
    free, _ = _record(_fast(root), _experiment(**still))
    loaded, _ = _record(_fast(root), _experiment(**still, setup={"payload": {"mass": 2.0, "com": [0.0, 0.0, 0.05]}}))
    off, _ = _record(_fast(root), _experiment(**still, setup={"drives_off": True}))
    arm = read_model(root / "config/models/puma560.toml")
    frames = link_frames(arm, np.zeros(6))
    bolted = frames[-1] @ [0.0, 0.0, 0.05, 1.0]
    weight = np.array([0.0, 0.0, -9.80665 * 2.0])
    joint2 = np.cross(frames[1][:3, 2], bolted[:3] - frames[1][:3, 3]) @ weight  # what gravity does about joint 2
    extra = (loaded.i - free.i)[:, 1].mean()
    assert extra == pytest.approx(-joint2 / (107.815 * 0.2587), abs=5e-3)
    assert np.abs(off.i.mean(axis=0)).max() < 1e-3 and np.ptp(off.counts, axis=0).max() <= 1


def test_hidden_arm_moves_under_the_servos_of_the_known_one(root: Path, tmp_path: Path) -> None:
    from dataclasses import replace

    from arm_model.model_file import write_model

    arm = read_model(root / "config/models/puma560.toml")
    heavy = replace(arm.joints[2], mass=9.6)
    write_model(tmp_path / "hidden.toml", replace(arm, joints=(*arm.joints[:2], heavy, *arm.joints[3:])))
    rig = _fast(root, model=str(tmp_path / "hidden.toml"))
    with open_bench(rig) as bench:
        moved = world_of(bench._context).plant.arm
    assert moved.joints[2].mass == 9.6
    from arm_model.servo import servo_gains

    assert np.allclose(servo_gains(moved).position, servo_gains(arm).position)


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ({"pace": "slow"}, "pace"),
        ({"fault": [{"kind": "lost_edge", "device": "counter1"}]}, "number: is missing"),
        ({"encoder": {"sine_gain": [1.0, 1.0]}}, "has 2 entries for 6 joints"),
        ({"encoder": {"sine_gain": 0.01}}, "does not reach its comparator"),
        ({"model": "nowhere.toml"}, "no such file"),
    ],
)
def test_a_wrong_simulation_table_gets_one_line(root: Path, table: dict, line: str) -> None:
    from arm_io import InputError

    rig = _fast(root, **table)
    with pytest.raises(InputError, match=line) as error, open_bench(rig):
        pass
    assert "\n" not in str(error.value)
