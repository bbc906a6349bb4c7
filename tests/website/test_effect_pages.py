"""The page of an effect: what it shows in a model file is a model file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from arm_model import read_model
from arm_model.effects import CATALOGUE
from website import effects


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_lines_of_a_model_file_are_accepted(name: str, root: Path, tmp_path: Path) -> None:
    page = effects.page(CATALOGUE[name])
    lines = re.search(r"```toml\n(.*?)```", page, re.S)
    assert lines is not None
    model = (root / f"config/models/{'underwater' if CATALOGUE[name].cylinder else 'puma560'}.toml").read_text()
    path = tmp_path / "model.toml"
    path.write_text(f"{model}\n{lines[1]}")
    assert read_model(path).effects[-1].name == name


def test_a_neighbour_is_named_on_both_pages() -> None:
    for effect in CATALOGUE.values():
        for other, how in effect.confused_with.items():
            assert f"[{effects.title(effect.name)}]" in effects.page(CATALOGUE[other])
            assert how.replace("|", "&#124;") in effects.page(effect)
    assert all(name in effects.listing() for name in CATALOGUE)
