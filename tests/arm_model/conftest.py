"""Machine code of these tests goes to a folder of their own, and the nominal Puma is at hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMSCOPE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def puma() -> Arm:
    return read_model(Path(__file__).resolve().parents[2] / "config/models/puma560.toml")
