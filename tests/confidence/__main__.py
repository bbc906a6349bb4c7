"""``make confidence``: cases with known answers, the table of confidence fitted to them, and its reliability diagram.

run   adds the names of new cases to the bank: foreign arms by both protocols and with two effects, and the Puma; a case
      that is in it is replaced
add   adds those of files that ``tests.foreign.proving_ground --out`` wrote
fit   fits ``diagnosis/confidence.json`` to the bank, judges it by cross-validation, and draws the diagram
check counts what was stated in such files, or those of ``tests.blind --out``, against what was right; the bank stays
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np

from diagnosis.confidence import TABLE
from tests.confidence import bank, diagram, outcomes
from tests.confidence.bank import Name
from tests.confidence.cross_validation import PRINTED_AS_98, chances, cross_validated, reliability
from tests.confidence.fit import fitted
from tests.executors import executor
from tests.foreign.pairs import pairs as foreign_pairs

ROOT = Path(__file__).resolve().parents[2]
DIAGRAM = ROOT / "docs" / "images" / "reliability.svg"


def main() -> None:
    options = _options()
    if options.do == "check":
        _print(outcomes.counted(*outcomes.stated(options.files)), options.json)
        return
    if options.do == "add":
        _add(options.files, options.commit)
    if options.do == "run":
        _run(options)
    names = bank.read()
    confidence, most = cross_validated(names)
    table = fitted(names, most) | {"provenance": {"bank": "tests/confidence/bank.json", "names": len(names)}}
    figures = judged(names, confidence)
    if options.do == "fit":
        TABLE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
        _draw(names, confidence)
    _print(figures, options.json)


def _print(figures: Mapping[str, float], as_json: bool) -> None:
    print(json.dumps(figures) if as_json else "\n".join(f"{key}: {value}" for key, value in figures.items()))


def judged(names: Sequence[Name], confidence: np.ndarray) -> dict[str, float]:
    """Flat figures of what was stated of names, beside those of 1 - p alone; and by kind of arm.

    confidence: (n,), by tables of other cases
    """
    figures: dict[str, float] = {"names": len(names), "cases": len({name.key for name in names})}
    figures |= {f"names_{suite}": count for suite, count in sorted(Counter(name.suite for name in names).items())}
    right, before = _right(names), _one_minus_p(names)
    for label, values in (("", confidence), ("before_", before)):
        said = values >= PRINTED_AS_98
        figures[f"{label}said_98"], figures[f"{label}right_of_these"] = int(said.sum()), int(right[said].sum())
        figures[f"{label}brier"] = round(float(np.mean((values - right) ** 2)), 4)
    for at, count, hits in reliability(confidence, right):
        figures[f"stated_{at:.3f}_names"], figures[f"stated_{at:.3f}_right"] = count, hits
    for suite in sorted({name.suite for name in names}):
        own = np.array([name.suite == suite for name in names])
        figures[f"{suite}_right"], figures[f"{suite}_expected"] = int(right[own].sum()), round(confidence[own].sum(), 1)
        few, many = chances(confidence[own], right[own])
        figures[f"{suite}_so_few_by_chance"], figures[f"{suite}_so_many_by_chance"] = round(few, 3), round(many, 3)
    return figures


def _draw(names: Sequence[Name], confidence: np.ndarray) -> None:
    right, before = _right(names), _one_minus_p(names)
    rows = [
        ("1 - p of the gain", "0.6", reliability(before, right)),
        ("stated", "tab:blue", reliability(confidence, right)),
    ]
    diagram.draw(DIAGRAM, rows)


def _right(names: Sequence[Name]) -> np.ndarray:
    """(n,) 1.0 where the name was right."""
    return np.array([name.right for name in names], float)


def _one_minus_p(names: Sequence[Name]) -> np.ndarray:
    """(n,) what the gain alone states."""
    return np.array([name.support.significance for name in names])


def _add(files: Sequence[Path], commit: str) -> None:
    for file in files:
        bank.write(bank.replaced(bank.read(), bank.of_foreign(file, commit)))


def _run(options: argparse.Namespace) -> None:
    """Names of new cases, each written to the bank as soon as it is there: a run of hours may be stopped."""
    chosen = bank.puma_chosen(options.seed, options.cases, options.only)
    pairs = [pair for pair in foreign_pairs(options.seed, options.cases) if _chosen(pair.name, options.only)]
    with executor(options.workers, options.scheduler) as pool:
        jobs = [pool.submit(bank.of_pair, pair, options.commit) for pair in pairs]
        jobs += [pool.submit(bank.of_puma, case, options.commit) for case in chosen]
        for number, done in enumerate(as_completed(jobs), 1):
            bank.write(bank.replaced(bank.read(), found := done.result()))
            print(f"{number:3}/{len(jobs)} {_line(found)}", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "foreign.json")
        words = {"seed": options.seed, "cases": options.cases, "workers": options.workers, "out": out}
        words |= {name: value for name in ("scheduler", "cache") if (value := getattr(options, name)) is not None}
        line = [word for name, value in words.items() for word in (f"--{name}", str(value))]
        only = ["--only", *options.only] if options.only else []
        command = [sys.executable, "-m", "tests.foreign.proving_ground", "--no-compare", *line, *only]
        subprocess.run(command, cwd=ROOT, check=True, stdout=sys.stderr)
        _add([out] if out.exists() else [], options.commit)


def _chosen(name: str, only: Sequence[str]) -> bool:
    """Whether a case has one of the words in its name, if there are any."""
    return not only or any(word in name for word in only)


def _line(found: Mapping[bank.Key, Sequence[Name]]) -> str:
    """A case and what was named in it."""
    said = (f"{one.effect}@{one.joint or '-'} {'right' if one.right else 'WRONG'}" for n in found.values() for one in n)
    return f"{', '.join(case for _, _, case in found)}: {', '.join(said) or 'nothing named'}"


def _head() -> str:
    """The commit of this checkout."""
    head = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return head.stdout.strip()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.confidence", description=__doc__)
    parser.add_argument("do", choices=("run", "add", "fit", "check"))
    parser.add_argument("files", nargs="*", type=Path, help="with add and check: outcomes of cases")
    parser.add_argument("--seed", type=int, default=0, help="of the new cases: one that the bank has not")
    parser.add_argument("--cases", type=int, default=20, help="of every kind, suite and protocol")
    parser.add_argument("--only", nargs="+", metavar="WORD", default=[], help="cases whose name has this in it")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps the logs of foreign arms for the next run")
    parser.add_argument("--commit", default=None, help="of the code that is judged; default: this checkout's")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="instead: the workers of a Dask scheduler")
    parser.add_argument("--json", action="store_true", help="print the figures as one flat JSON object")
    options = parser.parse_intermixed_args()
    options.commit = options.commit or _head()
    return options


if __name__ == "__main__":
    main()
