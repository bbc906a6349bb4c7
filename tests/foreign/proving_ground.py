"""``python -m tests.foreign.proving_ground``: effects hidden in arms that are not the Puma, through the command line.

The figures, and per case what was hidden and what was said.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import pickle
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from pathlib import Path

from tests.executors import executor
from tests.foreign import arms, cases, hide, log, motions, plant
from tests.foreign.cases import KINDS, PROTOCOLS, Case, Days
from tests.foreign.ended import unrendered
from tests.foreign.score import Outcome, figures, outcome
from tests.foreign.through import through

SHOWN = 3
"""Changes of a comparison that the table writes out."""


def main() -> None:
    options = _options()
    chosen = [
        case
        for protocol in options.protocol
        for kind in options.kind
        for case in cases.cases(protocol, kind, options.seed, options.cases)
        if not options.only or any(word in case.name for word in options.only)
    ]
    say = sys.stderr if options.json else sys.stdout
    print(f"seed {options.seed}, {len(chosen)} cases", file=say, flush=True)
    if not chosen:
        return
    outcomes: list[Outcome] = []
    with executor(options.workers, options.scheduler) as pool:
        running = [pool.submit(judged, case, options.cache, options.keep, options.compare) for case in chosen]
        for number, done in enumerate(as_completed(running), 1):
            outcomes.append(done.result())
            print(f"{number:3}/{len(chosen)} {outcomes[-1].line()}", file=say, flush=True)
            if options.out:
                _write(options.out, options.seed, outcomes)
    outcomes.sort(key=lambda one: (one.protocol, one.kind, one.name))
    summary = {"seed": options.seed, **figures(outcomes)}
    if options.out:
        _write(options.out, options.seed, outcomes)
    if options.json:
        print(json.dumps(summary))
        return
    print("\n" + table(outcomes) + "\n")
    for name, value in summary.items():
        print(f"{name}: {value:.4g}")


def judged(case: Case, cache: Path | None, keep: Path | None, compare: bool = True) -> Outcome:
    """One case from the draw to its score; an exception is a crash, not the end of the run."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if keep is None else keep / case.name
        days = _recorded(case, cache)
        began = time.perf_counter()
        try:
            with unrendered():
                results = through(case, days, folder, compare=compare)
            one = outcome(case, days.hidden, days.strength, results)
        except Exception:
            one = Outcome(case.name, case.protocol, case.kind, case.arm.name, vars(case.logger), [], days.strength)
            one.crashes = [traceback.format_exc()]
        one.seconds = time.perf_counter() - began
    return one


def _recorded(case: Case, cache: Path | None) -> Days:
    """The logs of a case, simulated once per version of what makes them."""
    if cache is None:
        return cases.recorded(case)
    cache.mkdir(parents=True, exist_ok=True)
    source = "".join(Path(str(one.__file__)).read_text() for one in (arms, plant, motions, log, hide, cases))
    source += arms.TABLE.read_text()
    kept = cache / f"{case.name}-{'-'.join(map(str, case.key))}-{hashlib.sha1(source.encode()).hexdigest()[:8]}.pickle"
    if not kept.exists():
        kept.write_bytes(pickle.dumps(cases.recorded(case)))
    days: Days = pickle.loads(kept.read_bytes())
    return days


def table(outcomes: Sequence[Outcome]) -> str:
    """What was hidden, and what ``diagnose`` and ``compare`` said of the same recordings, in Markdown."""
    rows = ["| arm | hidden | times the noise | diagnose | | compare | |", "|---|---|---|---|---|---|---|"]
    for o in outcomes:
        shown = f"{o.hidden[0]} {o.hidden[1] or ''}".strip() if o.hidden else "nothing"
        named = ", ".join(f"{effect} {joint or ''}".strip() for effect, joint, _, _ in o.named)
        said = f"{named or o.verdict} | {'' if o.good_diagnosis else 'wrong'} | {_compared(o)}"
        rows.append(f"| {o.arm} | {shown} | {o.strength:.1f} | {said} |")
    return "\n".join(rows)


def _compared(o: Outcome) -> str:
    """Two cells: the changes, surest first, and whether they are wrong."""
    if o.changed is None:
        return "not asked | "
    said = ", ".join(name for name, *_ in o.differing[:SHOWN]) or "no change"
    more = f" and {len(o.differing) - SHOWN} more" if len(o.differing) > SHOWN else ""
    wrong = bool(o.elsewhere) if o.compare is None else not o.compare or bool(o.elsewhere)
    return f"{said}{more} | {'wrong' if wrong else ''}"


def _write(path: Path, seed: int, outcomes: Sequence[Outcome]) -> None:
    content = {"seed": seed, "figures": figures(outcomes), "outcomes": [asdict(one) for one in outcomes]}
    path.write_text(json.dumps(content, indent=1))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.foreign.proving_ground", description=__doc__)
    parser.add_argument("--protocol", nargs="+", choices=PROTOCOLS, default=list(PROTOCOLS))
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--cases", type=int, default=24, metavar="N", help="of every kind and protocol")
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100000, help="of everything that is drawn")
    parser.add_argument("--only", nargs="+", metavar="WORD", help="cases whose name has this in it")
    parser.add_argument("--no-compare", dest="compare", action="store_false", help="diagnose only: half of the time")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="instead: the workers of a Dask scheduler")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps the logs for the next run")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keeps what the commands wrote")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="figures and every case")
    parser.add_argument(
        "--json", action="store_true", help="print the figures as one flat JSON object and nothing else"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
