"""The verdict of a comparison: what its causes explain and what they leave adds up to what changed."""

from __future__ import annotations

from comparison.change import Change, Kind, Quantity
from comparison.outcome import Comparison
from comparison.report.wording import verdict
from comparison.summary import Summary, of_significant


def changed(name: str, kind: Kind) -> Change:
    quantity = Quantity(name=name, words=name, unit="N m", kind=kind, joint=1)
    return Change(quantity=quantity, before=1.0, after=2.0, std=0.1, p=1e-9, corrected=1e-8)


def compared(changes: list[Change], explains: tuple[str, ...]) -> Comparison:
    said = f"Something explains {of_significant(len(explains), len(changes))}"
    cause = Summary(effect="payload", joint=None, parameters={}, explains=explains, sentence=said)
    return Comparison(what="recordings", arm=None, before=(), after=(), changes=changes, summaries=[cause])


def test_what_is_explained_and_what_is_left_add_up() -> None:
    kinds: tuple[Kind, ...] = ("inertia", "inertia", "friction", "curve", "effect")
    changes = [changed(f"p{k}", kind) for k, kind in enumerate(kinds)]
    some = verdict(compared(changes, ("p0", "p1")))
    assert some.startswith("Something explains 2 of 5 significant changes; 3 are left unexplained; 5 quantities")
    every = verdict(compared(changes, tuple(one.quantity.name for one in changes)))
    assert every.startswith("Something explains all 5 significant changes; nothing else of 5 compared quantities")
