"""All tests of this folder run in one process, which parses every file of ours once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.house.sources import parsed

HERE = Path(__file__).resolve().parent


@pytest.hookimpl(tryfirst=True)  # before the hook of all tests, which gives a file without a group its own
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """One group."""
    for item in items:
        if item.path.parent == HERE:
            item.add_marker(pytest.mark.xdist_group("house"))


def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """What is parsed is two hundred megabytes, which the tests of other folders do not need."""
    if nextitem is None or nextitem.path.parent != HERE:
        parsed.cache_clear()
