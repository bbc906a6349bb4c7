"""``make confidence``: cases with known answers, the table of confidence fitted to them, and its reliability diagram.

run   adds the names of new cases to the bank: foreign arms by both protocols, and the Puma
add   adds those of files that ``tests.foreign.proving_ground --out`` wrote
fit   fits ``diagnosis/confidence.json`` on one half of the bank, judges it on the other, and draws the diagram
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np

from diagnosis.confidence import TABLE
from tests.confidence import bank, diagram
from tests.confidence.bank import BANK, PUMA_KINDS, Name
from tests.confidence.fit import fitted, halves, reliability, stated
from tests.executors import executor

ROOT = Path(__file__).resolve().parents[2]
DIAGRAM = ROOT / "docs" / "images" / "reliability.svg"
EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.975, 1.0001)


def main() -> None:
    options = _options()
    if options.do in ("run", "add"):
        new = [name for file in options.files for name in bank.of_foreign(file)]
        new += _run(options.seed, options.cases, options.workers, options.scheduler) if options.do == "run" else []
        _keep(new)
    names = bank.read()
    table = fitted(halves(names)[0])
    figures = judged(table, names)
    if options.do == "fit":
        table["provenance"] = {"bank": "tests/confidence/bank.json", **{k: figures[k] for k in ("fitted", "judged")}}
        TABLE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
        _draw(table, names)
    print(json.dumps(figures) if options.json else "\n".join(f"{key}: {value}" for key, value in figures.items()))


def judged(table: dict, names: Sequence[Name]) -> dict[str, float]:
    """Figures of a table on the half that it was not fitted to, flat."""
    fit, other = halves(names)
    figures: dict[str, float] = {"fitted": len(fit), "judged": len(other)}
    figures |= {f"names_{suite}": count for suite, count in sorted(Counter(name.suite for name in names).items())}
    confidence, right, before = _columns(table, other)
    for label, values in (("", confidence), ("before_", before)):
        top = values >= 0.975
        figures[f"{label}said_98"], figures[f"{label}right_of_these"] = int(top.sum()), int(right[top].sum())
        figures[f"{label}brier"] = round(float(np.mean((values - right) ** 2)), 4)
    for at, share, count in reliability(confidence, right, EDGES):
        figures[f"stated_{at:.3f}"] = round(share, 3)
        figures[f"stated_{at:.3f}_names"] = count
    return figures


def _columns(table: dict, names: Sequence[Name]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) each: stated confidence, whether the name was right, and 1 - p alone."""
    confidence = np.array([stated(table, name) for name in names])
    return (
        confidence,
        np.array([name.right for name in names], float),
        np.array([n.support.significance for n in names]),
    )


def _draw(table: dict, names: Sequence[Name]) -> None:
    confidence, right, before = _columns(table, halves(names)[1])
    rows = [
        ("1 - p of the gain", "0.6", reliability(before, right, EDGES)),
        ("stated", "tab:blue", reliability(confidence, right, EDGES)),
    ]
    diagram.draw(DIAGRAM, rows)


def _keep(new: Sequence[Name]) -> None:
    """Adds names to the bank; a case that is in it already is replaced."""
    cases = {(name.suite, name.seed, name.case) for name in new}
    old = bank.read() if BANK.exists() else []
    kept = [name for name in old if (name.suite, name.seed, name.case) not in cases]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    together = sorted([*kept, *new], key=lambda one: (one.suite, one.seed, one.case, one.effect, one.joint or 0))
    bank.write(together, commit.stdout.strip())


def _run(seed: int, cases: int, workers: int, scheduler: str | None) -> list[Name]:
    """Names of new cases, ``cases`` of every kind."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "foreign.json")
        line = [
            "-m",
            "tests.foreign.proving_ground",
            "--seed",
            seed,
            "--cases",
            cases,
            "--workers",
            workers,
            "--out",
            out,
            *([] if scheduler is None else ["--scheduler", scheduler]),
        ]
        subprocess.run([sys.executable, *map(str, line)], cwd=ROOT, check=True)
        names = list(bank.of_foreign(out))
    with executor(workers, scheduler) as pool:
        jobs = [pool.submit(bank.of_puma, seed, kind, number) for kind in PUMA_KINDS for number in range(cases)]
        for done in as_completed(jobs):
            names += done.result()
            print(f"puma: {len(done.result())} names", flush=True)
    return names


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.confidence", description=__doc__)
    parser.add_argument("do", choices=("run", "add", "fit"))
    parser.add_argument("files", nargs="*", type=Path, help="with add: outcomes of tests.foreign.proving_ground")
    parser.add_argument("--seed", type=int, default=0, help="of the new cases: one that the bank has not")
    parser.add_argument("--cases", type=int, default=20, help="of every kind, suite and protocol")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="instead: the workers of a Dask scheduler")
    parser.add_argument("--json", action="store_true", help="print the figures as one flat JSON object")
    return parser.parse_args()


if __name__ == "__main__":
    main()
