"""Results show their report inside a notebook: the report that ``write`` writes, in a frame."""

from __future__ import annotations

from html import unescape
from pathlib import Path

import pytest

import armscope
from arm_model import parameter
from armscope.cli import run


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("inline")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run(["init", "arm", "--like", "csv"]) == 0
    return folder / "arm"


def test_an_identification_and_a_comparison(arm: Path, tmp_path: Path) -> None:
    model = armscope.read_model(arm / "model.toml")
    simulated = armscope.simulate(model, arm / "experiments/fit.toml")
    assert simulated._repr_html_().count("<img") == 1
    fit = simulated.write(tmp_path / "fit.mcap")
    found = armscope.identify(fit, model)
    found.write(tmp_path / "found")
    frame = found._repr_html_()
    assert frame.startswith("<iframe") and frame.count("<iframe") == 1
    page = unescape(frame.partition('srcdoc="')[2].rpartition('"')[0])
    assert page == (tmp_path / "found/report.html").read_text()
    (prediction,) = armscope.predict(fit, found.arm)
    axes = prediction.plot().axes
    assert len(axes) == 4 and {line.get_label() for line in axes[0].lines} >= {"measured", "predicted"}
    assert prediction._repr_html_().count("<img") == 1
    held = armscope.simulate(model, arm / "experiments/held_out.toml").write(tmp_path / "held.mcap")
    changed = armscope.compare(fit, held, model)
    assert "srcdoc" in changed._repr_html_()


def test_an_arm_shows_its_joints(arm: Path) -> None:
    """Friction and rotors are at the joint, as in the names of ``identify``."""
    pytest.importorskip("pandas")
    model = armscope.read_model(arm / "model.toml")
    table = model.to_pandas()
    assert list(table.index) == [1, 2] and list(table.type) == ["revolute", "revolute"]
    assert table.coulomb_positive[1] == pytest.approx(parameter(model, "joint1.coulomb"))
    assert table.rotor_inertia[2] == pytest.approx(model.joints[1].ratio ** 2 * model.joints[1].rotor_inertia)
    shown = model._repr_html_()
    assert shown.count("<tr>") == 3 and "&lt;Arm My arm: 2 joints" in shown
