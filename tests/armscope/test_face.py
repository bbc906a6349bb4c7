"""``import armscope``: what it offers, and that it costs nothing until it is used."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import armscope
from armscope import Arm, InputError

FUNCTIONS = (
    "open",
    "read_model",
    "read_rig",
    "read_experiment",
    "record",
    "simulate",
    "identify",
    "diagnose",
    "calibrate",
)


def test_nothing_heavy_is_imported_before_it_is_used() -> None:
    code = "import sys; before = set(sys.modules); import armscope; print(*sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    foreign = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names)
    assert foreign == {"armscope"}


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("load_fricton", {"mu": 0.1}, "no effect 'load_fricton'; is it load_friction?"),
        ("backlash", {"half_gap": -1e-3}, "half_gap: must not be negative (is -0.001 rad)"),
        ("load_friction", {"mu": float("nan")}, "mu: input should be a finite number"),
        ("coulomb_friction", {"coulomb": -1e6}, "friction"),
    ],
)
def test_no_model_is_written_or_used_that_could_not_be_read(
    root: Path, tmp_path: Path, name: str, values: dict[str, float], said: str
) -> None:
    arm = armscope.read_model(root / "config/models/two_link.toml")
    for use in (
        lambda wrong: armscope.write_model(tmp_path / "arm.toml", wrong),
        lambda wrong: armscope.simulate(wrong, root / "config/experiments/arms/rov_fit.toml"),
    ):
        with pytest.raises(InputError) as told:
            use(arm.with_effect(name, joint=1, **values))
        assert said in str(told.value) and not list(tmp_path.iterdir())


def test_every_name_that_is_offered_is_there() -> None:
    for name in armscope.__all__:
        assert getattr(armscope, name) is not None
    assert set(armscope.__all__) <= set(dir(armscope))
    for name in FUNCTIONS:
        assert callable(getattr(armscope, name)) and getattr(armscope, name).__doc__
    assert "coulomb_friction" in armscope.effects
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        armscope.nothing  # noqa: B018


def test_type_checkers_and_the_site_see_every_name_that_is_offered(root: Path) -> None:
    """They read the imports below ``if TYPE_CHECKING``; without its own there, a name is unknown to both."""
    (block,) = (
        node for node in ast.parse((root / "armscope/__init__.py").read_text()).body if isinstance(node, ast.If)
    )
    imported = [
        name.asname or name.name for node in block.body if isinstance(node, ast.ImportFrom) for name in node.names
    ]
    assert sorted([*imported, "effects", "__version__"]) == sorted(set(armscope.__all__) | {"CATALOGUE"})


def test_objects_are_taken_as_they_are(root: Path) -> None:
    arm = armscope.read_model(root / "config/models/puma560.toml")
    assert armscope.read_model(arm) is arm
    rig = armscope.read_rig(str(root / "config/puma560_sim.toml"))
    assert armscope.read_rig(rig) is rig
    motion = armscope.read_experiment(root / "config/experiments/iso_cube.toml")
    assert armscope.read_experiment(motion) is motion


def test_a_shipped_model_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(armscope.read_model("config/models/scara.toml")) == 3
    with pytest.raises(InputError, match=r"none\.toml"):
        armscope.read_model("config/models/none.toml")


def test_objects_show_themselves_in_one_line(root: Path) -> None:
    arm = armscope.read_model(root / "config/models/puma560_worn.toml")
    for one in (arm, armscope.effects["backlash"]):
        assert "\n" not in repr(one) and len(repr(one)) < 250
    assert "6 joints" in repr(arm) and all(term.name in repr(arm) for term in arm.effects)
    assert "half_gap rad" in repr(armscope.effects["backlash"])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda arm: armscope.identify("a.mcap", arm, method="wsl"), "method: must be one of ols, wls"),
        (
            lambda arm: armscope.identify("a.mcap", arm, method="motor-link", friction="symmetric"),
            "--friction: motor-link identifies the friction of each direction",
        ),
        (lambda arm: armscope.identify("a.mcap", arm, friction="asym"), "friction: must be one of symmetric, asymm"),
        (lambda arm: armscope.identify("a.mcap", arm, shape="curve"), "shape: must be one of auto, straight, free"),
        (lambda arm: armscope.identify([], arm), "recordings: is empty"),
        (lambda arm: armscope.diagnose([], arm), "recordings: is empty"),
        (lambda arm: armscope.diagnose(arm, "a.mcap"), "a model: must be the path of one|no such file"),
        (lambda arm: armscope.diagnose(arm, arm), "a recording: must be the path of one.*is Arm"),
        (lambda arm: armscope.open(3), "a recording: must be the path of one.*is int"),
        (lambda arm: armscope.read_model({"name": "x"}), "a model: must be the path of one.*is dict"),
        (lambda arm: armscope.simulate(arm, 3), "an experiment: must be the path of one.*is int"),
        (lambda arm: armscope.compare(3, 4), "compare: takes recordings and results.*is int"),
        (lambda arm: armscope.read_model(arm.with_effect("backlsh", joint=1)), "no effect 'backlsh'; is it backlash?"),
        (lambda arm: armscope.predict("a.mcap", arm.with_effect("backlash", joint=9, half_gap=0.1)), "joint in 1..6"),
    ],
)
def test_a_wrong_argument_is_one_line_that_names_it(call: Callable[[Arm], object], says: str, root: Path) -> None:
    with pytest.raises(InputError, match=says) as refused:
        call(armscope.read_model(root / "config/models/puma560.toml"))
    assert "\n" not in str(refused.value)


def test_help_shows_a_default_by_its_name() -> None:
    assert "= silent" in str(inspect.signature(armscope.diagnose))
