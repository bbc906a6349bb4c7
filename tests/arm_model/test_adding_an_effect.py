"""docs/adding-an-effect.md as it stands.

The definition on that page, put into the catalogue, is simulated and found by a diagnosis that does not know it.
"""

from __future__ import annotations

import doctest
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm_model.effects import CATALOGUE, Effect, Signals, Values
from armscope.cli import run
from tests.arm_model import test_coefficients as coefficients
from tests.arm_model import test_effect_definitions as definitions

PAGE = "docs/adding-an-effect.md"


def _definition(page: str) -> str:
    """The block of the page that defines the effect."""
    return next(block for block in page.split("```python\n")[1:] if "EFFECTS = (" in block).partition("```")[0]


@pytest.fixture
def effect(root: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Effect]:
    """The effect of the page, in the catalogue for as long as a test runs."""
    module: dict[str, object] = {}
    exec(compile(_definition((root / PAGE).read_text(encoding="utf-8")), PAGE, "exec"), module)
    (defined,) = module["EFFECTS"]  # type: ignore[misc]
    assert defined.name not in CATALOGUE, "the example of the page should be an effect that the catalogue lacks"
    monkeypatch.setitem(CATALOGUE, defined.name, defined)
    yield defined


def test_is_simulated_and_found(
    effect: Effect, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["init", "my_arm", "--like", "csv"]) == 0
    capsys.readouterr()
    flags = doctest.ELLIPSIS | doctest.REPORT_NDIFF
    result = doctest.testfile(str(root / PAGE), module_relative=False, optionflags=flags)
    assert result.attempted > 8
    assert result.failed == 0, capsys.readouterr().out


def test_passes_the_tests_that_every_effect_has(effect: Effect) -> None:
    definitions.test_has_one_law_and_says_what_it_is(effect)
    definitions.test_says_by_which_instrument_it_is_observed_what_excites_it_and_where_its_parameters_are_searched(
        effect
    )
    definitions.test_names_other_effects_by_names_that_exist(effect)
    definitions.test_law_is_linear_in_what_it_calls_linear(effect.name)
    definitions.test_symbols_give_the_numbers_of_the_law(effect.name)
    coefficients.test_law_at_solved_parameters_is_the_sum_of_columns(effect.name, "", ())
    coefficients.test_spans_one_plane_of_one_size(effect)


def test_has_the_limits_that_the_page_says(effect: Effect) -> None:
    assert effect.torque is not None
    p, slow, fast = Values(viscous=20.0, thinning_velocity=0.3), np.array([-1e-6, 1e-6]), np.array([-1e6, 1e6])
    np.testing.assert_allclose(effect.torque(p, Signals(v=slow)), 20.0 * slow, rtol=1e-5)
    np.testing.assert_allclose(effect.torque(p, Signals(v=fast)), 20.0 * 0.3 * np.sign(fast), rtol=1e-5)


def test_diagnosis_does_not_know_it(effect: Effect, root: Path) -> None:
    texts = [path.read_text(encoding="utf-8") for path in (root / "diagnosis").rglob("*.py")]
    assert len(texts) > 20
    assert not any(effect.name in text for text in texts)
