"""What every test may use: the checkout, measured data that is not ours to ship, a browser; the last two may skip."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from arm_io.parallel import CORES
from armscope.allocation import for_computation
from tests.chromium import CHROMIUM, chromium
from tests.pauses import Pauses

ROOT = Path(__file__).resolve().parent.parent

IN_REAL_TIME = ("arm_page", "armscope", "daq", "drivers", "sim_backend")
"""Folders whose tests run instruments, daemons and clients against the clock."""

INSTRUMENTS = ("daq", "drivers")
"""Folders whose tests mostly wait for instruments: one process of ``-n`` runs them all, before those that compute."""

LOWER = 10
"""Priority (nice value) of the processes that compute: a tenth of a core where an instrument wants it (sched(7))."""

pauses = Pauses()

# Before the modules of tests are imported, which make a million objects that stay.
for_computation()

# How long an example takes says how busy the machine is, not whether the code is right.
hypothesis.settings.register_profile(
    "explore", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow], print_blob=True
)
# `make test` says the same of the same commit; `make explore` draws new examples.
hypothesis.settings.register_profile("armscope", hypothesis.settings.get_profile("explore"), derandomize=True)
hypothesis.settings.load_profile("armscope")


def pytest_configure(config: pytest.Config) -> None:
    """Ctrl-C means what it means at a terminal, also where a script runs the tests in the background.

    There the shell has SIGINT ignored, and every process inherits that. Of the processes of ``-n`` each has a core:
    forks of one that holds half a gigabyte are a tenth of its time.
    """
    if hasattr(config, "workerinput"):
        os.environ.setdefault(CORES, "1")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in the same hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The tests of a file run in one process of ``--dist loadgroup``, unless a group of files is stated.

    Fixtures of a module and kept results are then made once, not once in every process. The tests of instruments are
    one group; as the largest it starts first, in a process of its own.

    A test in real time that fails while tasks waited for a core is run again, twice at most; the summary counts it as a
    rerun. On a machine that kept nobody waiting its first result stands.
    """
    for item in items:
        folder = _folder(item)
        if folder in IN_REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=2, condition=pauses.long))
        if item.get_closest_marker("xdist_group") is None:
            group = "instruments" if folder in INSTRUMENTS else item.path.relative_to(ROOT).as_posix()
            item.add_marker(pytest.mark.xdist_group(group))


def _folder(item: pytest.Item) -> str:
    """The folder of ``tests`` that a test lies in, or its file if it lies in none."""
    return item.path.relative_to(ROOT / "tests").parts[0]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A process of ``-n`` that computes gives way to the one that runs instruments, for good: see ``INSTRUMENTS``."""
    if hasattr(item.config, "workerinput") and _folder(item) not in INSTRUMENTS:
        os.setpriority(os.PRIO_PROCESS, 0, max(LOWER, os.getpriority(os.PRIO_PROCESS, 0)))
    pauses.start()


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """Reference figures and measured data (``ARMSCOPE_SHARED``, else ``../shared`` beside the checkout)."""
    place = Path(os.environ.get("ARMSCOPE_SHARED", ROOT.parent / "shared"))
    if not place.is_dir():
        pytest.skip(f"no reference data at {place}; set ARMSCOPE_SHARED")
    return place


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; .ci/run installs it")
    with chromium() as opened:
        yield opened
