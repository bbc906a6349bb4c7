"""The bank: one row per name that a diagnosis gave, with its evidence and whether it was right.

A case is known by its suite, seed and name; a case in which nothing was named has no row.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from arm_model.model_file import read_model
from diagnosis.cause import Support
from diagnosis.diagnose import diagnose
from tests.blind.cases import Case as PumaCase
from tests.blind.cases import cases as puma_cases
from tests.blind.generate import generate
from tests.blind.record import MODEL
from tests.blind.recordings import read_recordings
from tests.blind.score import right
from tests.foreign.pairs import Pair, diagnosed
from tests.foreign.score import in_group
from tests.foreign.score import right as is_hidden_abroad

BANK = Path(__file__).with_name("bank.json")
PUMA_KINDS = ("singles", "weak", "pairs", "empties")
NAMED = ("named", "supports", "owned")
"""Columns of an outcome with an entry per name."""
Key = tuple[str, int, str]


@dataclass(frozen=True)
class Name:
    """One name.

    suite: foreign-first, foreign-second or puma; seed and case: where it is from; commit: of the code that gave it.
    right: whether it, or another of its ambiguity group, was hidden: that is what a confidence is of
    """

    suite: str
    seed: int
    case: str
    effect: str
    joint: int | None
    right: bool
    support: Support
    commit: str

    @property
    def key(self) -> Key:
        """Of its case."""
        return self.suite, self.seed, self.case


def read(path: Path = BANK) -> list[Name]:
    """The names of a bank's file."""
    rows = json.loads(path.read_text(encoding="utf-8"))["names"]
    return [Name(**{**row, "support": Support(**row["support"])}) for row in rows]


def write(names: Sequence[Name], path: Path = BANK) -> None:
    """One row per line, sorted, so that a difference shows what changed."""
    ordered = sorted(names, key=lambda one: (*one.key, one.effect, one.joint or 0))
    rows = ",\n ".join(json.dumps(asdict(name)) for name in ordered)
    path.write_text(f'{{"names": [\n {rows}\n]}}\n', encoding="utf-8")


def replaced(old: Sequence[Name], new: Mapping[Key, Sequence[Name]]) -> list[Name]:
    """Names with those of the new cases; of a case that is there already none is kept, also if it has no name now."""
    return [name for name in old if name.key not in new] + [name for names in new.values() for name in names]


def of_foreign(path: Path, commit: str) -> dict[Key, list[Name]]:
    """Per case of what ``tests.foreign.proving_ground --out`` wrote; without ripples that the healthy arm has."""
    content, found = json.loads(path.read_text(encoding="utf-8")), {}
    for outcome in content["outcomes"]:
        key = (f"foreign-{outcome['protocol']}", content["seed"], outcome["name"])
        if outcome["crashes"]:
            continue
        found[key] = [
            Name(*key, effect, joint, was_right, Support(**support), commit)
            for (effect, joint, _, was_right), support, its_own in zip(*(outcome[column] for column in NAMED))
            if support is not None and not its_own
        ]
    return found


def of_pair(pair: Pair, commit: str) -> dict[Key, list[Name]]:
    """Of a foreign arm with two effects, and a model that knows everything else."""
    key = ("foreign-first", pair.first.key[0], pair.name)
    hidden, results = diagnosed(pair)
    if results.diagnosis is None:
        return {}
    causes = results.diagnosis["causes"]
    flags = matched(causes, hidden, is_hidden_abroad, in_group)
    return {
        key: [
            Name(*key, cause["effect"], cause["joint"], was_right, Support(**cause["support"]), commit)
            for cause, was_right in zip(causes, flags)
            if cause["support"] is not None
        ]
    }


def matched(causes: Sequence[Any], hidden: Iterable[Any], *tests: Callable[[Any, Any], bool]) -> list[bool]:
    """Whether each cause is one of the hidden effects, by the first of the tests that finds it; each is found once."""
    left, flags = list(hidden), [False] * len(causes)
    for test in tests:
        for at, cause in enumerate(causes):
            one = None if flags[at] else next((one for one in left if test(cause, one)), None)
            if one is not None:
                left.remove(one)
                flags[at] = True
    return flags


def puma_chosen(seed: int, count: int, only: Sequence[str]) -> list[PumaCase]:
    """``count`` cases of every kind of the other suite; with ``only``, those with one of its words in their name."""
    every = (case for kind in PUMA_KINDS for case in puma_cases(kind, seed, count))
    return [case for case in every if not only or any(word in case.name for word in only)]


def of_puma(case: PumaCase, commit: str) -> dict[Key, list[Name]]:
    """Of one case of the other suite."""
    key = ("puma", case.key[0], case.name)
    with tempfile.TemporaryDirectory() as folder:
        _, hidden = generate(case, Path(folder))
        result = diagnose(read_model(MODEL), *read_recordings(Path(folder)))
    places = [(one["effect"], one["joint"]) for one in hidden]
    flags = matched(
        result.causes, places, lambda cause, place: right(cause, *place), lambda cause, one: one in cause.group
    )
    return {
        key: [
            Name(*key, *cause.key, was_right, cause.support, commit)
            for cause, was_right in zip(result.causes, flags)
            if cause.support is not None
        ]
    }
