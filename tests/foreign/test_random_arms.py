"""A few random arms through every command; ``python -m tests.foreign`` takes 500."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image

from tests.foreign.commands import through_every_command
from tests.foreign.ended import Ended, called, unfit, unrendered
from tests.foreign.random_arms import stranger
from tests.foreign.written import flaws


@pytest.mark.parametrize("seed", [8, pytest.param(36, marks=pytest.mark.slow)])
def test_an_arm_goes_through_every_command(seed: int, tmp_path: Path) -> None:
    with unrendered():
        several = list(through_every_command(seed, tmp_path))
    assert [one for one in several if not one.well] == []
    assert {"simulate", "identify", "diagnose", "calibrate"} <= {one.command.split()[0] for one in several}


def test_a_refusal_of_what_a_command_made_up_itself_is_a_crash() -> None:
    """Seven diagnoses of the arms 30254 to 30292 ended so: a cause that was tried left no arm."""
    made_up = "error: random 1: effect[1]: link_inertia makes joint 2 impossible: mass: input should be positive\n"
    assert not Ended("diagnose", 2, made_up).well
    assert Ended("identify", 2, "error: model: has no [controller]\n").well


@pytest.mark.parametrize(
    ("status", "said", "well"),
    [
        (0, "note: joint 2 stands\n", True),
        (0, "note: 0 of 0 rows\n", False),
        (0, "warning: an rms of nan\n", False),
        (0, "regression.py:3: RuntimeWarning: overflow encountered in multiply\n", False),
        (2, "error: model.toml: joint[1]: 'nan' is no number\n", True),
        (2, "error: one\nerror: two\n", False),
        (2, "error: diagnose: needs more memory than this machine has; give it fewer rows\n", False),
        (3, "", False),
        (5, "changed beyond --fail-above 10%: 1 quantities: joint7.viscous\n", True),
        (5, "", False),
        (5, "regression.py:3: RuntimeWarning: overflow encountered in multiply\n", False),
    ],
)
def test_how_a_command_ends_well(status: int, said: str, well: bool) -> None:
    assert Ended("diagnose", status, said).well == well


@pytest.mark.parametrize(
    ("words", "printed", "fit"),
    [
        (["model", "--json"], '{"mass": null}', True),
        (["model", "--json"], '{"mass": NaN}', False),
        (["model", "--json"], 'note\n{"mass": 1}', False),
        (["info"], "joint 1: 0.1 A rms", True),
        (["info"], "joint 1: nan A rms", False),
        (["info"], "name: 'nan'", True),
        (["model", "--equations", "python"], "value = None", True),
    ],
)
def test_what_a_command_prints_is_judged(words: list[str], printed: str, fit: bool) -> None:
    assert (unfit(words, printed) == "") == fit


def test_a_motion_is_designed_for_a_urdf_file(tmp_path: Path) -> None:
    seed = next(seed for seed in range(100) if stranger(seed).urdf and len(stranger(seed).model) == 2)
    model, _ = stranger(seed).write(tmp_path)
    ended = called("excite", "--model", model, "--out", tmp_path / "motion.toml", "--candidates", 32)
    assert (ended.status, ended.said) == (0, "")


def test_strangers_are_as_different_as_they_say() -> None:
    arms = [stranger(seed) for seed in range(200)]
    joints = [joint for one in arms for joint in one.model.joints]
    assert {len(one.model) for one in arms} == set(range(1, 9))
    assert {joint.convention for joint in joints} == {"standard", "modified", "placed"}
    assert {joint.type for joint in joints} == {"revolute", "prismatic"}
    assert any(joint.mass == 0.0 for joint in joints) and any(joint.rotor_inertia == 0.0 for joint in joints)
    assert any(one.urdf for one in arms) and any(one.model.controller is None for one in arms)
    assert any(one.model.coupling for one in arms) and {1.0, 1000.0} <= {joint.ratio for joint in joints}
    masses = [joint.mass for joint in joints if joint.mass]
    assert min(masses) < 1e-4 and max(masses) > 50.0


def test_a_dressed_file_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    """Every change of a URDF file, on arms of different sizes: most of them can be read."""
    read = 0
    for seed in (one for one in range(80) if stranger(one).urdf):
        model, _ = stranger(seed).write(tmp_path)
        ended = called("model", model)
        assert ended.well, ended
        read += ended.status == 0
    assert read > 15


@pytest.mark.slow
def test_500_arms_go_through_every_command() -> None:
    assert subprocess.run([sys.executable, "-m", "tests.foreign", "--arms", "500"], check=False).returncode == 0


def test_pictures_that_are_left_out_can_be_read() -> None:
    """A report opens its own pictures."""
    picture = io.BytesIO()
    with unrendered():
        Figure().savefig(picture, format="png")
    assert Image.open(picture).size == (1, 1)


@pytest.mark.parametrize(
    ("name", "text", "flaw"),
    [
        ("a.json", '{"rms": NaN}', "NaN in JSON"),
        ("a.json", '{"rms": [1.0, Infinity]}', "Infinity in JSON"),
        ("a.json", '{"rms": ', "Expecting value"),
        ("a.toml", "mass = [1.0, nan]", "nan in TOML"),
        ("a.toml", "mass = ", "Invalid value"),
        ("a.csv", "t,q1\n0.0,1.0\n0.1", "line 3 has 1 fields, the header 2"),
        ("a.html", "<html><body><p>half", "no whole page"),
        ("a.html", "<html><body><table><td>nan</td></table></body></html>", "has nan in a table"),
        ("a.urdf", "<robot><link>", "no element found"),
        ("a.mcap.active", "", "left behind half written"),
        (".a.json", "", "left behind half written"),
    ],
)
def test_what_cannot_be_opened_is_a_flaw(name: str, text: str, flaw: str, tmp_path: Path) -> None:
    (tmp_path / "well.json").write_text('{"rms": [1.0, null]}')
    (tmp_path / ".diagnosis.files").write_text("{}")
    (tmp_path / "well.html").write_text("<html><body><br><td>0.1</td></body></html>")
    assert flaws(tmp_path) == []
    (tmp_path / name).write_text(text)
    (found,) = flaws(tmp_path)
    assert found.startswith(name) and flaw in found
