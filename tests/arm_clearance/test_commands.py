"""``excite``, ``record`` and ``plot`` keep an arm clear of the world, or say why not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm_clearance import Space
from arm_io import InputError, read_toml, write_toml
from arm_model import read_model, write_model
from arm_model.collision import chain_of
from arm_model.rigid_body import link_frames
from arm_model.urdf import read_urdf
from armscope.cli import run
from armscope.motion import clearance_of
from daq.rig import read_rig
from daq.rig.preflight import check_motion
from experiment import demand_of, read_experiment
from identification.experiment_design import Limits, Series, design_excitation
from tests.arm_clearance.arms import UR5, ur5_urdf

SMALL = ["--candidates", "32", "--duration", "5", "--fundamental", "0.4", "--harmonics", "2"]


@pytest.fixture(scope="module")
def ur5(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ur5")
    write_model(folder / "ur5.toml", read_urdf(ur5_urdf(folder / "ur5.urdf")))
    return folder / "ur5.toml"


def _heights(q: np.ndarray) -> np.ndarray:
    """(k, 6) z m of the origins of the maker's D-H frames, multiplied out here."""
    frame, found = np.broadcast_to(np.eye(4), (len(q), 4, 4)), []
    for j, (a, d, alpha, _) in enumerate(UR5):
        c, s, ca, sa = np.cos(q[:, j]), np.sin(q[:, j]), round(np.cos(alpha), 12), round(np.sin(alpha), 12)
        zero, one = np.zeros_like(c), np.ones_like(c)
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [zero, sa * one, ca * one, d * one]]
        step = np.array([*rows, [zero, zero, zero, one]]).transpose(2, 0, 1)
        frame = frame @ step
        found.append(frame[:, 2, 3])
    return np.array(found).T


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ur5_stays_above_its_table(ur5: Path, tmp_path: Path, seed: int) -> None:
    """By frames multiplied out here; the same command without a floor goes far below, and says so."""
    out = tmp_path / "e.toml"
    command = ["excite", "--model", str(ur5), "--out", str(out), *SMALL, "--seed", str(seed)]
    assert run([*command, "--floor", "0"]) == 0
    demand = demand_of(read_experiment(out))
    q = demand(np.arange(0.0, demand.duration, 0.004))
    radius = chain_of(read_model(ur5)).bodies[1].radius
    # The shoulder cannot move up or down; the frames behind it keep the margin from the surface of their capsules.
    assert _heights(q)[:, 1:].min() > radius + 0.02
    assert np.ptp(q, axis=0).min() > 0.1


def test_without_a_floor_the_depth_is_said(ur5: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / "e.toml"
    command = ["excite", "--model", str(ur5), "--out", str(out), *SMALL]
    assert run(command) == 0
    assert "no floor and no boxes were given: links reach down to" in capsys.readouterr().out
    demand = demand_of(read_experiment(out))
    found = clearance_of(demand, chain_of(read_model(ur5)), None)
    heights = _heights(demand(np.arange(0.0, demand.duration, 0.004)))
    radius = chain_of(read_model(ur5)).bodies[1].radius
    assert found["lowest"] == pytest.approx(heights.min() - radius, abs=0.002)
    assert found["lowest"] < -0.3 and found["least"] is None


def test_a_box_is_avoided_and_the_same_seed_gives_the_same_motion(ur5: Path, tmp_path: Path) -> None:
    (tmp_path / "space.toml").write_text(
        'floor = -0.1\n[[box]]\nname = "crate"\nlow = [0.2, -0.3, 0.1]\nhigh = [0.5, 0.3, 0.5]\n'
    )
    command = ["excite", "--model", str(ur5), *SMALL, "--space", str(tmp_path / "space.toml")]
    for name in ("one", "two"):
        assert run([*command, "--out", str(tmp_path / f"{name}.toml")]) == 0
    assert (tmp_path / "one.toml").read_text() == (tmp_path / "two.toml").read_text()
    demand = demand_of(read_experiment(tmp_path / "one.toml"))
    q = demand(np.arange(0.0, demand.duration, 0.01))
    frames = link_frames(read_model(ur5), q)[..., :3, 3]
    shares = np.linspace(0.0, 1.0, 9)[:, None, None, None]
    along = (1 - shares) * frames[:, 1:-1] + shares * frames[:, 2:]
    inside = ((along > [0.2, -0.3, 0.1]) & (along < [0.5, 0.3, 0.5])).all(axis=-1)
    assert not inside.any()


def test_no_motion_is_found_where_there_is_no_room(ur5: Path) -> None:
    from dataclasses import replace

    from arm_clearance import Box, pairs_of

    arm = read_model(ur5)
    full = Space(
        box=[
            Box(name="concrete", low=(-2, -2, 0.2), high=(2, 2, 2)),
            Box(name="b", low=(-2, -2, -2), high=(2, 2, 0.05)),
        ]
    )
    limits = replace(Limits.of(arm), pairs=pairs_of(chain_of(arm), full))
    with pytest.raises(InputError, match="no motion keeps clear: 64 of 64 start poses"):
        design_excitation(arm, Series(4.0, 0.5, 2), limits=limits, candidates=32)


def _rig(root: Path, tmp_path: Path, space: dict) -> Path:
    table = read_toml(root / "config/puma560_sim.toml")
    table["model"] = str(root / "config/models/puma560.toml")
    table["simulation"]["pace"] = "fast"
    write_toml(tmp_path / "rig.toml", table | {"space": space})
    return tmp_path / "rig.toml"


BENCH = {"name": "bench", "low": [0.2, -1.0, -1.0], "high": [2.0, 1.0, 1.0]}


def test_record_refuses_before_arming(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    rig = _rig(root, tmp_path, {"box": [BENCH], "self_collision": False})
    experiment = root / "config/experiments/excitation.toml"
    out = tmp_path / "run.mcap"
    assert run(["record", "--rig", str(rig), "--experiment", str(experiment), "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len([line for line in said if line.startswith("error:")]) == 1
    assert "of box 'bench'" in said[-1] or "overlaps box 'bench'" in said[-1]
    assert list(tmp_path.iterdir()) == [rig]
    # A floor far below changes nothing else.
    wide = read_rig(_rig(root, tmp_path, {"floor": -3.0, "self_collision": False}), drivers=False)
    chain = chain_of(read_model(root / "config/models/puma560.toml"))
    assert check_motion(wide, read_experiment(experiment), chain) == []
    assert "was not given the arm's links" in check_motion(wide, read_experiment(experiment))[0]


def test_tool_point_keeps_its_limits(root: Path, tmp_path: Path) -> None:
    rig = read_rig(_rig(root, tmp_path, {"low": [0.0, -2, -2], "high": [2, 2, 2]}), drivers=False)
    chain = chain_of(read_model(root / "config/models/puma560.toml"))
    arm = read_model(root / "config/models/puma560.toml")
    experiment = read_experiment(root / "config/experiments/excitation.toml")
    demand = demand_of(experiment)
    tool = link_frames(arm, demand(np.arange(0, demand.duration, 1e-3)))[:, -1] @ np.array(arm.tool)
    beyond = 1000 * (0.0 - tool[:, 0, 3].min())
    assert beyond > 10
    (problem,) = check_motion(rig, experiment, chain)
    assert float(problem.partition("[space] by ")[2].partition(" mm")[0]) == pytest.approx(beyond, abs=1.0)


def test_a_folded_arm_meets_itself(ur5: Path, tmp_path: Path) -> None:
    """The forearm of a UR5 folded back onto the upper arm: both axes in one plane."""
    from arm_clearance import check_clearance

    chain = chain_of(read_model(ur5))
    move = {"type": "move", "to": [0.0, -1.5, 3.1, 0.0, 0.0, 0.0]}
    table = {
        "name": "fold",
        "start": [0.0, -1.5, 0.2, 0, 0, 0],
        "full_speed": [1.0] * 6,
        "full_acceleration": [2.0] * 6,
    }
    write_toml(tmp_path / "fold.toml", table | {"segment": [move]})
    demand = demand_of(read_experiment(tmp_path / "fold.toml"))
    said = check_clearance(demand, chain, Space())
    assert len(said) == 1 and "link" in said[0].split(" overlaps ")[1]
    assert check_clearance(demand, chain, Space(self_collision=False, floor=-2.0)) == []


def test_motion_is_drawn(ur5: Path, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    experiment = str(root / "config/experiments/excitation.toml")
    rig = _rig(root, tmp_path, {"floor": 0.0, "box": [BENCH], "low": [-1, -1, 0], "high": [1, 1, 2]})
    assert run(["plot", experiment, "--rig", str(rig), "--out", str(tmp_path / "m.svg")]) == 0
    assert "bench" in (tmp_path / "m.svg").read_text() or (tmp_path / "m.svg").stat().st_size > 50_000
    assert run(["plot", experiment, "--out", str(tmp_path / "n.png")]) == 2
    assert "--model: is missing" in capsys.readouterr().err
    assert not (tmp_path / "n.png").exists()


def _removed(key: str) -> Callable[[dict], dict]:
    return lambda table: {name: value for name, value in table.items() if name != key}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("floor = 'low'", "floor: input should be a valid number"),
        ("margin = -1.0", "margin: input should be greater than or equal to 0"),
        ("low = [1, 0, 0]\nhigh = [0, 1, 1]", "'low' must be below 'high' along x"),
        ('[[box]]\nname = "a"\nlow = [0, 0, 0]\nhigh = [1, 0, 1]', "box 'a': 'low' must be below 'high' along y"),
        ("[[box]]\nlow = [0, 0, 0]\nhigh = [1, 1, 1]", "box[1].name: is missing"),
        ("flor = 1.0", "flor: unknown entry"),
    ],
)
def test_a_wrong_space_is_one_line(
    ur5: Path, tmp_path: Path, capsys: pytest.CaptureFixture, text: str, said: str
) -> None:
    (tmp_path / "space.toml").write_text(text)
    out = tmp_path / "e.toml"
    assert run(["excite", "--model", str(ur5), "--out", str(out), "--space", str(tmp_path / "space.toml")]) == 2
    line = capsys.readouterr().err.strip()
    assert said in line and "\n" not in line and not out.exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--floor", "nan"], "--floor: must be a finite number"),
        (["--floor", "1e9"], "--floor: must be a height in m"),
        (["--floor", "0", "--plot", "z.txt"], "z.txt: the name of a picture must end in"),
        (["--space", "none.toml"], "none.toml: no such file"),
    ],
)
def test_a_wrong_option_is_one_line(
    ur5: Path, tmp_path: Path, capsys: pytest.CaptureFixture, options: list[str], said: str
) -> None:
    out = tmp_path / "e.toml"
    assert run(["excite", "--model", str(ur5), "--out", str(out), *options]) == 2
    line = capsys.readouterr().err.strip()
    assert said in line and "\n" not in line and not out.exists()


def test_a_space_needs_a_model(root: Path, tmp_path: Path) -> None:
    table = read_toml(root / "config/puma560_sim.toml") | {"space": {"floor": 0.0}}
    write_toml(tmp_path / "rig.toml", _removed("model")(table))
    with pytest.raises(InputError, match="space: needs 'model'"):
        read_rig(tmp_path / "rig.toml", drivers=False)


def test_capsules_come_from_urdf_and_stay_in_the_model(tmp_path: Path) -> None:
    shapes = {
        0: '<collision><geometry><cylinder radius="0.08" length="0.1"/></geometry></collision>',
        2: '<collision><origin xyz="-0.2 0 0.1"/><geometry><box size="0.4 0.06 0.08"/></geometry></collision>',
        3: '<collision><geometry><mesh filename="package://forearm.stl"/></geometry></collision>',
        6: '<collision><geometry><sphere radius="0.04"/></geometry></collision>',
    }
    arm = read_urdf(ur5_urdf(tmp_path / "ur5.urdf", shapes))
    write_model(tmp_path / "ur5.toml", arm)
    assert read_model(tmp_path / "ur5.toml") == arm
    bodies = {body.link: body for body in chain_of(arm).bodies}
    assert [link for link, body in bodies.items() if body.assumed] == [1, 3, 4, 5]
    box = bodies[2]
    assert np.allclose([box.start, box.end], [[-0.4, 0, 0.1], [0.0, 0, 0.1]]) and box.radius == pytest.approx(0.05)
    assert bodies[0].radius == 0.08 and np.allclose(bodies[0].start, -bodies[0].end)
    assert np.allclose(bodies[6].start, bodies[6].end) and bodies[6].radius == 0.04
    bad = ur5_urdf(tmp_path / "bad.urdf", {1: shapes[6].replace("0.04", "-1")})
    with pytest.raises(InputError, match="needs sizes above 0"):
        read_urdf(bad)
