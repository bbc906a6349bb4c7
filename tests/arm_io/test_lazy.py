"""A lazy face imports a name when it is first used, and nothing else."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest


def test_names_come_when_they_are_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "a_lazy_package"
    package.mkdir()
    (package / "__init__.py").write_text(
        "from typing import TYPE_CHECKING\n"
        "from arm_io import lazy\n"
        "if TYPE_CHECKING:\n"
        "    from a_lazy_package import second\n"
        "    from a_lazy_package.first import thing, other as another\n"
        "else:\n"
        "    __getattr__ = lazy(__name__)\n"
    )
    (package / "first.py").write_text("thing, other = object(), 2\n")
    (package / "second.py").write_text("value = 3\n")
    monkeypatch.syspath_prepend(tmp_path)
    import a_lazy_package  # type: ignore[import-not-found]

    assert not {"a_lazy_package.first", "a_lazy_package.second"} & set(sys.modules)
    assert a_lazy_package.another == 2 and a_lazy_package.thing is a_lazy_package.thing
    assert "a_lazy_package.second" not in sys.modules
    assert a_lazy_package.second.value == 3
    for missing in ("value", "other", "__wrapped__"):
        with pytest.raises(AttributeError, match=missing):
            getattr(a_lazy_package, missing)
