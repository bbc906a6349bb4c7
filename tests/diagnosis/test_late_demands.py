"""A loop that does not follow the arm because its demands were recorded late is told so, with the delay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armscope
from diagnosis.closed_loop.comparison import LoopComparison, simulated_behind

T = np.arange(0.0, 20.0, 0.002)


def _loop(error: np.ndarray) -> LoopComparison:
    """Of one joint whose measured angle is the simulated one and an error (m,) rad; friction is known in all rows."""
    angle = (0.5 * np.sin(1.3 * T) + 0.1 * np.sin(7.0 * T))[:, None]
    still = np.zeros_like(angle)
    one = LoopComparison("a.mcap", T, still, still, angle + error[:, None], angle, np.ones((0, 1), bool))
    return replace(one, known=np.ones((len(one.error("angle")), 1), bool))


@pytest.mark.parametrize("delay", [3e-4, -2e-3])
def test_a_delay_is_found_with_its_sign(delay: float) -> None:
    speed = 0.65 * np.cos(1.3 * T) + 0.7 * np.cos(7.0 * T)
    found, share = simulated_behind([_loop(delay * speed)], 1)
    assert found == pytest.approx(delay, rel=1e-3)
    assert share > 0.999


def test_an_error_that_is_no_delay_has_no_share_in_it() -> None:
    assert simulated_behind([_loop(1e-3 * np.sin(1.3 * T))], 1)[1] < 0.01
    assert simulated_behind([_loop(0.0 * T)], 1) == (0.0, 0.0)


def test_demands_that_were_recorded_late_are_told_in_the_verdict(root: Path, tmp_path: Path) -> None:
    model = root / "config/models/two_link.toml"
    logs = []
    for seed in (1, 2):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 16.0, 0.01)
        phase = np.multiply.outer(t, [0.5, 1.3, 3.1])[:, None] + rng.uniform(0.0, 6.0, (2, 3))
        asked = np.sin(phase) @ np.array([0.4, 0.25, 0.1])
        asked = (asked - asked[0]) * np.clip((t - 1.0) / 2.0, 0.0, 1.0)[:, None]
        table = {f"{name}{j + 1}": asked[:, j] for name in ("q", "i", "qref") for j in (0, 1)}
        armscope.import_table(pd.DataFrame({"t": t} | table), tmp_path / "asked.mcap")
        armscope.simulate(model, like=tmp_path / "asked.mcap", rate=450.0).write(tmp_path / "ran.mcap")
        run = armscope.open(tmp_path / "ran.mcap")
        noise = 5e-3 * rng.standard_normal(run.i.shape)
        assert run.qref is not None
        late = np.concatenate([run.qref[:1], run.qref[:-1]])
        step = 2 * np.pi / 2**22
        columns = {"q": np.round(run.q / step) * step, "i": run.i + noise, "qref": late}
        values = {f"{name}{j + 1}": column[:, j] for name, column in columns.items() for j in (0, 1)}
        logs.append(tmp_path / f"{seed}.mcap")
        armscope.import_table(pd.DataFrame({"t": run.t} | values), logs[-1])
    verdict = str(armscope.diagnose(logs[0], model, held_out=logs[1]))
    assert "2.2 ms behind, as if the demands had been recorded so much too late" in verdict
