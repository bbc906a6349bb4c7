"""``make blind``: the hidden-effect suite. ``--generator second``: by another plant (``tests.blind.second``).

Recall, superfluous names, false alarms, unmodelled defects, parameters, confidence, seconds, confusion.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from arm_model.model_file import read_model
from diagnosis.diagnose import diagnose
from diagnosis.report.write import table_of
from tests.blind.cases import KINDS, Case, cases
from tests.blind.generate import cache_name, generate
from tests.blind.record import MODEL
from tests.blind.recordings import read_recordings
from tests.blind.score import Outcome, confusion, figures, outcome, reliability
from tests.blind.second import cases as second_cases
from tests.blind.second import generate as second
from tests.blind.second.laboratory import own_springs
from tests.blind.second.strangers import VARIABLES
from tests.blind.unmodelled import EXPLANATORY
from tests.executors import executor

AnyCase = Case | second_cases.Case


def main() -> None:
    options = _options()
    chosen = drawn(options.generator, options.kind, options.seed, options.cases, options.only or ())
    say = sys.stderr if options.json else sys.stdout
    print(f"seed {options.seed}, {len(chosen)} cases", file=say)
    outcomes: list[Outcome] = []
    crashed = 0
    with executor(options.workers, options.scheduler) as pool:
        running = {pool.submit(judged, case, options.cache): case.name for case in chosen}
        for number, done in enumerate(as_completed(running), 1):
            if (error := done.exception()) is not None:
                # the other cases are told all the same
                crashed += 1
                print(f"{number:3}/{len(chosen)} CRASHED {running[done]}: {error!r}", file=say, flush=True)
                traceback.print_exception(error)
                continue
            outcomes.append(done.result())
            print(f"{number:3}/{len(chosen)} {outcomes[-1].line()}", file=say, flush=True)
            if options.out:
                write(options.out, options.seed, outcomes)
    outcomes.sort(key=lambda o: o.name)
    summary = {"seed": options.seed, **figures(outcomes)} if outcomes else {"seed": options.seed}
    if options.out:
        write(options.out, options.seed, outcomes)
    if options.json:
        print(json.dumps(summary))
    else:
        report(outcomes, summary)
    if crashed:
        sys.exit(f"{crashed} of {len(chosen)} cases crashed; the figures are of the others")


def write(path: Path, seed: int, outcomes: Sequence[Outcome]) -> None:
    """Figures and every case so far, as JSON."""
    summary = {"seed": seed, **figures(outcomes)} if outcomes else {"seed": seed}
    path.write_text(json.dumps({"figures": summary, "outcomes": [asdict(o) for o in outcomes]}, indent=1))


def drawn(
    generator: str, kinds: Sequence[str] | None, seed: int, count: int | None, only: Sequence[str]
) -> list[AnyCase]:
    """Cases of a generator, a little of every kind first: a run that is stopped says something about all of them."""
    draw, every = (second_cases.cases, second_cases.COUNTS) if generator == "second" else (cases, KINDS)
    found: list[AnyCase] = [
        case
        for kind in kinds or every
        for case in draw(kind, seed, count)
        if not only or any(name in case.name for name in only)
    ]
    return sorted(found, key=lambda case: case.number)


def judged(case: AnyCase, cache: Path | None) -> Outcome:
    """One case from the draw to its score."""
    with _folder(case, cache) as folder:
        start = time.perf_counter()
        if isinstance(case, Case):
            where, hidden = generate(case, folder)
            model, explanatory, own = MODEL, EXPLANATORY, list[dict[str, object]]()
        else:
            where, hidden = second.generate(case, folder)
            model, explanatory = folder / second.MODEL, VARIABLES
            softened = [joint for effect, joint in case.effects if effect in {"joint_compliance", "backlash"}]
            own = own_springs(where, softened)
        generated = time.perf_counter() - start
        fit, held_out = read_recordings(folder)
        arm = read_model(model)
        start, spent = time.perf_counter(), _cpu()
        result = diagnose(arm, fit, held_out)
        seconds, spent = time.perf_counter() - start, _cpu() - spent
        one = outcome(case, where, hidden, result, table_of(result, fit, held_out), explanatory, own)
    one.seconds, one.generated, one.cpu = seconds, generated, spent
    return one


def _cpu() -> float:
    """s of this process and of those that it has waited for."""
    return sum(os.times()[:4])


@contextmanager
def _folder(case: AnyCase, cache: Path | None) -> Iterator[Path]:
    if cache is not None:
        yield cache / (cache_name(case) if isinstance(case, Case) else second.cache_name(case))
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def report(outcomes: Sequence[Outcome], summary: dict[str, float]) -> None:
    """For people."""
    print("\nconfusion (hidden -> named, where they differ):")
    pairs = confusion(outcomes)
    for (hidden, named), count in sorted(pairs.items()):
        if hidden != named:
            print(f"  {hidden:24} -> {named:24} {count}")
    right = sum(count for (hidden, named), count in pairs.items() if hidden == named)
    print(f"  (right: {right})")
    print("\nparameters beyond two stated standard deviations:")
    for o in outcomes:
        for p in o.parameters:
            if not p["inside"]:
                print(f"  {o.name}: {p['effect']}.{p['name']} {p['value']:.4g} +- {p['std']:.2g}, true {p['true']:.4g}")
    print("\nconfidence: stated -> right (names)")
    for low, high, count, stated, was_right in reliability(outcomes):
        print(f"  {low:.2f}-{high:.2f}: {stated:.3f} -> {was_right:.3f} ({count})")
    print()
    for name, value in summary.items():
        print(f"{name}: {value:.4g}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.blind", description=__doc__)
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100000, help="of everything that is drawn")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=[])
    parser.add_argument("--generator", choices=("first", "second"), default="first")
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", help="cases whose name (kind-number-effect@joint) has this in it"
    )
    parser.add_argument("--cases", type=int, metavar="N", help="of every kind")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps the recordings for the next run")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="instead: the workers of a Dask scheduler")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="figures and every case")
    parser.add_argument(
        "--json", action="store_true", help="print the figures as one flat JSON object and nothing else"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
