"""``armscope diagnose`` refuses options that would change nothing, before it reads a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from armscope.cli import run

DISTORT = ["--model", "no.toml", "--distort", "joint2.viscous"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ([*DISTORT, "--held-out", "no.mcap"], "--held-out: has no effect with --distort"),
        ([*DISTORT, "--rig", "no.toml"], "--rig: has no effect with --distort"),
        ([*DISTORT, "--yes"], "--yes: has no effect with --distort"),
        (["--distort", "joint2.viscous", "--rig", "no.toml", "--yes"], "--yes: has no effect with --distort"),
        (["--model", "no.toml", "--yes"], "--yes: has no effect without --rig"),
        (["--model", "no.toml", "--max-experiments", "3"], "--max-experiments: has no effect without --rig"),
        (["--distort", "joint2.viscous", "--rig", "no.toml"], "no.toml: "),
        (["--rig", "no.toml", "--yes", "--max-experiments", "3"], "no.toml: "),
    ],
)
def test_an_option_without_effect_is_refused(
    more: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["diagnose", "--fit", "no.mcap", *more, "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {said}") and error.count("\n") == 1
    assert not list(tmp_path.iterdir())
