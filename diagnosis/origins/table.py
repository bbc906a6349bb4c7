"""The table of physical origins (``origins.toml``): the signs of each, how to check it, and sources.

Its numbers are engineering judgement, not measured frequencies.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from arm_io import check_table, read_toml

PATH = Path(__file__).with_name("origins.toml")
EFFECT = "effect"
"""Of ``chance``: any effect of the catalogue."""

Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
Sentence = Annotated[str, Field(min_length=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Origin(_Strict):
    """One physical origin.

    scope   whether it is judged per joint or once for the arm and its rig
    prior   a word of ``Table.priors``
    signs   effect, or ``effect:qualifier`` -> a word of ``Table.strengths``
    check   what confirms or refutes it
    source  keys of ``Table.sources``
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    title: Sentence
    scope: Literal["joint", "arm"]
    prior: str
    signs: Annotated[dict[str, str], Field(min_length=1)]
    check: Sentence
    source: Annotated[tuple[str, ...], Field(min_length=1)]


class Table(_Strict):
    """All origins, and the probabilities that the words of their entries stand for.

    strengths   probability of a sign where its origin is present
    priors      probability of an origin before any evidence
    chance      probability of a sign where its origin is absent: of any ``effect``, and of each qualifier of one
    qualifiers  what each says of a cause
    sources     where a mechanism or a check is described
    """

    strengths: dict[str, Probability]
    priors: dict[str, Probability]
    chance: dict[str, Probability]
    qualifiers: dict[str, Sentence]
    origin: tuple[Origin, ...]
    sources: dict[str, Sentence]

    @model_validator(mode="after")
    def _complete(self) -> Self:
        names = [one.name for one in self.origin]
        if len(set(names)) < len(names):
            raise ValueError("origin: names must differ")
        if set(self.chance) != {EFFECT, *self.qualifiers}:
            raise ValueError("chance: must have an entry of every qualifier, and one of effect")
        for one in self.origin:
            unknown = [
                *({one.prior} - set(self.priors)),
                *(set(one.signs.values()) - set(self.strengths)),
                *(set(one.source) - set(self.sources)),
                *({sign.partition(":")[2] for sign in one.signs} - {"", *self.qualifiers}),
            ]
            if unknown:
                raise ValueError(f"origin {one.name}: {', '.join(unknown)} is not explained in the table")
        return self

    def present(self, origin: Origin, sign: str) -> float:
        """Likelihood ratio of a sign that was found; 1 where the origin does not list it."""
        word = origin.signs.get(sign)
        return 1.0 if word is None else self.strengths[word] / self._chance(sign)

    def absent(self, origin: Origin, sign: str) -> float:
        """Likelihood ratio of a sign that was searched for and not found; 1 where the origin does not list it."""
        word = origin.signs.get(sign)
        return 1.0 if word is None else (1.0 - self.strengths[word]) / (1.0 - self._chance(sign))

    def _chance(self, sign: str) -> float:
        return self.chance[sign.partition(":")[2] or EFFECT]


@cache
def read_table(path: Path = PATH) -> Table:
    """The table of a file. InputError naming the first wrong entry."""
    return check_table(path, read_toml(path), Table)
