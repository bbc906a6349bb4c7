"""The file beside a model that says how well its parameters are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, read_model, write_model
from arm_model.tables import Uncertainty, uncertainty_of

NAMES = ("joint1.viscous", "joint1.coulomb_positive", "link2.mx", "joint3.rotor_inertia")


def _known(rng: np.random.Generator) -> tuple[Uncertainty, np.ndarray]:
    """Of sizes that differ by many decades, and of less than full rank."""
    root = rng.normal(size=(4, 3)) * np.array([1e3, 1.0, 1e-4, 1e-7])[:, None]
    known = uncertainty_of("m.json", NAMES, root @ root.T, (0.1, 0.0, 0.2, 0.0, 0.0, 0.0))
    more = replace(known, in_loop=(0.0, 0.3) * 3, against=("position", "") * 3, ripple=(0.05, 1.0) * 3)
    shares = ("time_skew", 0.03), ("joint2.current_offset", 0.2)
    return replace(more, aliased=shares, recordings=("0f", "a1")), root @ root.T


@pytest.fixture
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.mark.parametrize("seed", range(5))
def test_a_model_is_read_back_with_what_is_known_of_it(arm: Arm, tmp_path: Path, seed: int) -> None:
    known, covariance = _known(np.random.default_rng(seed))
    write_model(tmp_path / "own.toml", replace(arm, uncertainty=known))
    read = read_model(tmp_path / "own.toml")
    assert read == arm and read.uncertainty is not None
    assert (read.uncertainty.file, read.uncertainty.left_over) == ("own_uncertainty.json", known.left_over)
    assert (read.uncertainty.in_loop, read.uncertainty.against) == (known.in_loop, known.against)
    assert (read.uncertainty.ripple, read.uncertainty.recordings) == (known.ripple, known.recordings)
    assert read.uncertainty.aliased == known.aliased
    size = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.abs((read.uncertainty.matrix - covariance) / size).max() < 1e-6
    directions = read.uncertainty.directions
    assert np.abs((directions @ directions.T - covariance) / size).max() < 1e-5


def test_a_model_carried_alone_is_exact_and_remembers_the_name(arm: Arm, tmp_path: Path) -> None:
    write_model(tmp_path / "model.toml", replace(arm, uncertainty=_known(np.random.default_rng(0))[0]))
    (tmp_path / "model_uncertainty.json").unlink()
    alone = read_model(tmp_path / "model.toml")
    assert alone == arm and alone.uncertainty == Uncertainty("model_uncertainty.json")
    write_model(tmp_path / "again.toml", alone)
    assert read_model(tmp_path / "again.toml").uncertainty is None


GOOD = {
    "schema": "armscope.uncertainty/1",
    "parameters": ["joint1.viscous", "joint1.coulomb"],
    "covariance": [[1.0], [0.5, 2.0]],
}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"schema": "armscope.uncertainty/2"}, "schema"),
        ({"parameters": ["joint1.viscous", "joint9.coulomb"]}, "joint9"),
        ({"parameters": ["joint1.viscous", "joint1.viscous"]}, "once"),
        ({"covariance": [[1.0], [0.5]]}, "lower triangle of 2 rows"),
        ({"covariance": [[1.0], [5.0, 2.0]]}, "semidefinite"),
        ({"covariance": [[-1.0], [0.0, 2.0]]}, "positive"),
        ({"covariance": [["a"], [0.0, 2.0]]}, "covariance"),
        ({"left_over": [0.1]}, "1 entries"),
        ({"left_over_against": ["position"]}, "left_over_against: has 1 entries"),
        ({"left_over": [-0.1] * 6}, "left_over"),
        ({"left_over_ripple": [1.1] * 6}, "left_over_ripple"),
        ({"left_over_shares": {"time_skew": 1.1}}, "left_over_shares"),
        ({"more": 1}, "unknown"),
    ],
)
def test_another_file_is_refused_in_one_line(arm: Arm, tmp_path: Path, changed: dict[str, object], said: str) -> None:
    write_model(tmp_path / "model.toml", replace(arm, uncertainty=_known(np.random.default_rng(0))[0]))
    beside = tmp_path / "model_uncertainty.json"
    beside.write_text(json.dumps(GOOD))
    assert read_model(tmp_path / "model.toml").uncertainty is not None
    beside.write_text(json.dumps(GOOD | changed))
    with pytest.raises(InputError, match=said) as error:
        read_model(tmp_path / "model.toml")
    assert "\n" not in str(error.value) and str(beside) in str(error.value)


@pytest.mark.parametrize("text", ["", "[]", "{", "nan", "[" * 100_000])
def test_what_is_no_such_json_is_refused(arm: Arm, tmp_path: Path, text: str) -> None:
    write_model(tmp_path / "model.toml", replace(arm, uncertainty=_known(np.random.default_rng(0))[0]))
    (tmp_path / "model_uncertainty.json").write_text(text)
    with pytest.raises(InputError, match=r"model_uncertainty\.json"):
        read_model(tmp_path / "model.toml")


def test_the_file_is_beside_the_model_and_nowhere_else(root: Path, tmp_path: Path) -> None:
    text = (root / "config/models/puma560.toml").read_text()
    (tmp_path / "model.toml").write_text(text.replace('units = "SI"', 'units = "SI"\nuncertainty = "../x.json"'))
    with pytest.raises(InputError, match="uncertainty"):
        read_model(tmp_path / "model.toml")
