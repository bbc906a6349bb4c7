"""Effects hidden in a plant that shares no code with the finder have to be found; the fast part of the suite.

Every case is recorded through encoder steps and a 12-bit current, and comes to the finder as files would: columns only.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_model.model_file import read_model
from diagnosis.diagnose import Diagnosis, diagnose
from tests.blind.hide import Hidden
from tests.blind.motions import suite
from tests.blind.record import nominal_plant, record
from tests.blind.recordings import recordings_of

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

CASES = {
    "nothing": (),
    "coulomb_friction": (Hidden("coulomb_friction", 1, {"coulomb": 4.0}),),
    "load_friction": (Hidden("load_friction", 2, {"mu": 0.08}),),
    "base_tilt": (Hidden("base_tilt", None, {"roll": 0.01, "pitch": 0.015}),),
    "time_skew": (Hidden("time_skew", None, {"delay": 0.003}),),
    "pair": (
        Hidden("friction_drift", 1, {"fraction": 0.25, "time_constant": 8.0}),
        Hidden("current_offset", 3, {"offset": 0.06}),
    ),
}


def _diagnosed(root: Path, name: str) -> Diagnosis:
    model = root / "config" / "models" / "puma560.toml"
    plant, seed = nominal_plant(model), sum(map(ord, name)) % 97
    fit, held_out = suite(seed)
    experiments = [*fit[:3], *held_out[:2]]
    taken = [record(plant, e, CASES[name], seed * 100 + number) for number, e in enumerate(experiments)]
    recordings = recordings_of(taken, [e.name for e in experiments])
    return diagnose(read_model(model), recordings[:3], recordings[3:])


FAST = ("nothing", "pair")  # half a minute each; the others are slow tests


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [n if n in FAST else pytest.param(n, marks=pytest.mark.slow) for n in CASES])
def test_names_what_is_hidden_and_nothing_else(name: str, root: Path) -> None:
    result = _diagnosed(root, name)
    wanted = {(hidden.effect, hidden.joint) for hidden in CASES[name]}
    found = {(cause.effect, cause.joint) for cause in result.causes}
    assert found == wanted
    assert result.verdict == ("explained" if wanted else "consistent")
    for hidden in CASES[name]:
        cause = next(c for c in result.causes if (c.effect, c.joint) == (hidden.effect, hidden.joint))
        for parameter in cause.parameters:
            assert abs(parameter.value - hidden.parameters[parameter.name]) < 4 * parameter.std + 0.02 * abs(
                parameter.value
            )
        assert cause.after < 0.8 * cause.before
