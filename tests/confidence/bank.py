"""The bank: one row per name that a diagnosis gave, with its evidence and whether it was right."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from arm_model.model_file import read_model
from diagnosis.cause import Support
from diagnosis.diagnose import diagnose
from tests.blind.cases import Case as PumaCase
from tests.blind.cases import cases as puma_cases
from tests.blind.generate import generate
from tests.blind.record import MODEL
from tests.blind.recordings import read_recordings
from tests.blind.score import right

BANK = Path(__file__).with_name("bank.json")
PUMA_KINDS = ("singles", "weak", "pairs", "empties")


@dataclass(frozen=True)
class Name:
    """One name.

    suite: foreign-first, foreign-second or puma; seed and case: where it is from
    """

    suite: str
    seed: int
    case: str
    effect: str
    joint: int | None
    right: bool
    support: Support


def read(path: Path = BANK) -> list[Name]:
    """The names of a bank's file."""
    rows = json.loads(path.read_text(encoding="utf-8"))["names"]
    return [Name(**{**row, "support": Support(**row["support"])}) for row in rows]


def write(names: Sequence[Name], commit: str, path: Path = BANK) -> None:
    """One row per line, so that a difference shows what changed."""
    rows = ",\n ".join(json.dumps(asdict(name)) for name in names)
    path.write_text(f'{{"commit": {json.dumps(commit)},\n"names": [\n {rows}\n]}}\n', encoding="utf-8")


def of_foreign(path: Path) -> Iterable[Name]:
    """Of what ``tests.foreign.proving_ground --out`` wrote."""
    content = json.loads(path.read_text(encoding="utf-8"))
    for outcome in content["outcomes"]:
        suite = f"foreign-{outcome['protocol']}"
        for (effect, joint, _, was_right), support in zip(outcome["named"], outcome["supports"]):
            if support is not None:
                yield Name(suite, content["seed"], outcome["name"], effect, joint, was_right, Support(**support))


def of_puma(seed: int, kind: str, number: int) -> list[Name]:
    """Of one case of the other suite."""
    case = list(puma_cases(kind, seed, number + 1))[number]
    with tempfile.TemporaryDirectory() as folder:
        return _named(case, seed, Path(folder))


def _named(case: PumaCase, seed: int, folder: Path) -> list[Name]:
    _, hidden = generate(case, folder)
    result = diagnose(read_model(MODEL), *read_recordings(folder))
    left = [(one["effect"], one["joint"]) for one in hidden]
    names = []
    for cause in result.causes:
        key = next((key for key in left if right(cause, *key)), None)
        if key is not None:
            left.remove(key)
        if cause.support is not None:
            names.append(Name("puma", seed, case.name, *cause.key, key is not None, cause.support))
    return names
