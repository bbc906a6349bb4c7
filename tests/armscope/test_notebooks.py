"""The notebooks in examples/ run from the first cell to the last, in an empty folder, and show their results."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("pandas")
pytest.importorskip("xarray")

SLOW = ("first_hour", "emps", "worn_puma")
SHOWN = {
    "first_hour": ("nothing was lost", "xarray", "iframe", "Archive"),
    "own_arm": ("joint1.coulomb", "iframe", "fit.mcap"),
    "emps": ("link1.mass", "iframe"),
    "worn_puma": ("load_friction", "iframe"),
}
"""What must be among the outputs of each."""


def executed(name: str, root: Path, folder: Path) -> str:
    """All outputs as text; fails where a cell does."""
    notebook = nbformat.read(root / f"examples/{name}.ipynb", as_version=4)
    os.environ.setdefault("JUPYTER_PLATFORM_DIRS", "1")
    client = nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}})
    client.create_kernel_manager()
    client.km.kernel_spec.argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    client.execute(env={**os.environ, "PYTHONPATH": str(root)})
    return nbformat.writes(notebook)


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in SHOWN]
)
def test_a_notebook_runs(name: str, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request) -> None:
    if name == "emps":
        monkeypatch.setenv("ARMSCOPE_EMPS", str(request.getfixturevalue("shared") / "data/emps"))
    before = _files(root / "examples")
    outputs = executed(name, root, tmp_path)
    assert _files(root / "examples") == before, "a notebook writes where it runs"
    assert [word for word in SHOWN[name] if word not in outputs] == []


def _files(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if "__pycache__" not in path.parts}


def test_examples_hold_notebooks_programs_and_the_files_of_the_first_hour_only(root: Path) -> None:
    """What a notebook wrote where it ran is not kept; examples/own_arm is input, of docs/first-hour-own-arm.md."""
    if not (root / ".git").exists():
        pytest.skip("not a checkout")
    listed = subprocess.run(["git", "ls-files", "examples"], cwd=root, capture_output=True, text=True, check=True)
    paths = [Path(line) for line in listed.stdout.splitlines()]
    inputs = {path.name for path in paths if path.parent.name == "own_arm"}
    assert inputs == {"arm.urdf", *(f"{day}_{run}.csv" for day in ("healthy", "today") for run in (1, 2))}
    assert {path.suffix for path in paths if path.parent.name != "own_arm"} == {".py", ".ipynb"}


def test_every_notebook_is_tested_and_kept_without_outputs(root: Path) -> None:
    paths = sorted((root / "examples").glob("*.ipynb"))
    assert {path.stem for path in paths} == set(SHOWN)
    for path in paths:
        cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
        assert all(not cell.outputs and cell.execution_count is None for cell in cells), path.name
