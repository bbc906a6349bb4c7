"""``make blind``: the hidden-effect suite. Confusion matrix, recall, false alarms, parameter error, seconds."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from arm_model.model_file import read_model
from diagnosis.diagnose import Diagnosis, diagnose
from tests.blind.cases import SAME, Case, cases
from tests.blind.motions import suite
from tests.blind.record import nominal_plant, record
from tests.blind.recordings import recordings_of

MODEL = Path(__file__).resolve().parents[2] / "config" / "models" / "puma560.toml"


def right(named: tuple[str, int | None], hidden: tuple[str, int | None], group: set[tuple[str, int | None]]) -> bool:
    """Whether a name is the hidden one, or stands for it in a true group."""
    if named == hidden:
        return True
    return any({named[0], hidden[0]} <= same for same in SAME) and hidden in group


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.blind", description=__doc__)
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100000)
    parser.add_argument("--magnitude", type=float, nargs="+", default=[1.0])
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--empty", type=int, default=5)
    parser.add_argument("--only", nargs="*", help="effects to hide, singly")
    options = parser.parse_args()
    plant, arm = nominal_plant(MODEL), read_model(MODEL)
    tally: Counter[str] = Counter()
    confusion: Counter[tuple[str, str]] = Counter()
    inside, parameters, seconds = 0, 0, []
    print(f"seed {options.seed}")
    for case in cases(options.seed, tuple(options.magnitude), options.pairs, options.empty):
        if options.only and not (len(case.hidden) == 1 and case.hidden[0].effect in options.only):
            continue
        fit, held_out = suite(case.seed)
        taken = [record(plant, e, case.hidden, case.seed * 100 + k) for k, e in enumerate([*fit, *held_out])]
        recordings = recordings_of(taken, [e.name for e in (*fit, *held_out)])
        start = time.perf_counter()
        result = diagnose(arm, recordings[: len(fit)], recordings[len(fit) :])
        seconds.append(time.perf_counter() - start)
        found, extra, hits, total = judge(case, result, confusion)
        inside, parameters = inside + hits, parameters + total
        tally[f"{case.kind}: cases"] += 1
        tally[f"{case.kind}: all named"] += found
        tally[f"{case.kind}: superfluous names"] += extra
        tally[f"{case.kind}: unexplained"] += result.verdict == "unexplained"
        hidden = ", ".join(f"{h.effect}@{h.joint or '-'}" for h in case.hidden) or "nothing"
        named = ", ".join(f"{c.effect}@{c.joint or '-'}" for c in result.causes) or "nothing"
        print(
            f"{'ok ' if found and not extra else 'NOT'} {case.kind:12} {hidden} -> {named} ({result.verdict}, {seconds[-1]:.0f} s)"
        )
        sys.stdout.flush()
    print("\nconfusion (hidden -> named):")
    for (hidden, named), count in sorted(confusion.items()):
        print(f"  {hidden:24} -> {named:24} {count}")
    for name, value in sorted(tally.items()):
        print(f"{name}: {value}")
    print(f"parameters within 2 stated standard deviations: {inside} of {parameters}")
    print(f"seconds a case: median {np.median(seconds):.1f}")


def judge(case: Case, result: Diagnosis, confusion: Counter[tuple[str, str]]) -> tuple[bool, int, int, int]:
    """Whether all hidden were named; superfluous names; parameters within two deviations, of how many compared."""
    left = list(result.causes)
    found, hits, total = True, 0, 0
    for hidden in () if case.unknown else case.hidden:
        match = next((c for c in left if right((c.effect, c.joint), (hidden.effect, hidden.joint), set(c.group))), None)
        if match is None:
            found = False
            confusion[hidden.effect, left[0].effect if left else "-"] += 1
            continue
        left.remove(match)
        confusion[hidden.effect, match.effect] += 1
        for parameter in match.parameters:
            if parameter.name in hidden.parameters and match.effect == hidden.effect:
                total += 1
                error = parameter.value - hidden.parameters[parameter.name]
                if parameter.name == "phase":
                    error = (error + np.pi) % (2 * np.pi) - np.pi
                hits += abs(error) <= 2 * parameter.std + 1e-12
    for cause in left:
        if case.unknown or not case.hidden:
            confusion["-" if not case.hidden else case.hidden[0].effect, cause.effect] += 1
    if case.unknown:
        found = not left and result.verdict == "unexplained"
    return found, len(left), hits, total


if __name__ == "__main__":
    main()
