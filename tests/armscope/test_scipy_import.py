"""scipy as the commands import it: without notes in its documentation, and otherwise the same."""

from __future__ import annotations

import subprocess
import sys

import pytest

USED = "from scipy import fft, interpolate, linalg, ndimage, optimize, signal, sparse, special, stats"
CHECKED = """
import numpy as np
x = np.random.default_rng(1).normal(size=400)
print(stats.ks_2samp(x[:200], x[200:]).pvalue, signal.welch(x)[1].sum(), optimize.brentq(np.cos, 0.0, 3.0))
print(stats.kurtosis(x), stats.f.logsf(3.0, 2, 9), ndimage.median_filter(x, 5).sum(), special.erf(0.3))
"""


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_functions_are_the_same() -> None:
    plain = run(f"{USED}{CHECKED}")
    assert run(f"from armscope.scipy_import import without_notes\nwithout_notes()\n{USED}{CHECKED}") == plain


@pytest.mark.parametrize("before", [True, False])
def test_only_imports_that_come_later_are_without(before: bool) -> None:
    """What a session has imported keeps its parser."""
    first = "import scipy.signal\n" if before else ""
    code = "from armscope.scipy_import import without_notes\nwithout_notes()\nimport scipy.signal\n"
    code += "from scipy._lib._array_api import FunctionDoc\nprint(FunctionDoc.__module__)"
    assert (run(first + code).strip() == "armscope.scipy_import") != before


def test_an_scipy_without_that_parser_is_imported_as_it_is() -> None:
    code = "import sys\nsys.modules['scipy._lib._docscrape'] = None\n"
    assert run(f"{code}from armscope.scipy_import import without_notes\nwithout_notes()\nprint('done')") == "done\n"
