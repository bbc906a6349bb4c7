"""Options that a command line gets beside the ones it needs, drawn at random; a person may give each of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

Generator = np.random.Generator
Words = tuple[object, ...]
SHARE = 0.2
"""of the options that a command has, it gets so many."""


class Options:
    """Draws options for the commands on one arm of ``joints`` joints; files that they write go to ``folder``."""

    def __init__(self, rng: Generator, joints: int, folder: Path) -> None:
        self.rng, self.joints, self.folder = rng, joints, folder

    def of(self, command: str) -> Words:
        """Some of the options of a command, with values."""
        several = [drawn(self) for drawn in OPTIONS[command] if self.rng.random() < SHARE]
        return tuple(word for words in several for word in words)

    def one_of(self, *values: object) -> object:
        """One of the values, as it is."""
        return values[int(self.rng.integers(len(values)))]

    def joint(self) -> int:
        """The number of a joint."""
        return int(self.rng.integers(1, self.joints + 1))

    def parameter(self) -> str:
        """A parameter of a joint or link, which the arm may have or not."""
        return str(
            self.one_of(
                *(f"joint{self.joint()}.{name}" for name in JOINT), *(f"link{self.joint()}.{name}" for name in LINK)
            )
        )


JOINT = ("viscous", "coulomb", "rotor_inertia", "offset", "torque_constant")
LINK = ("mass", "mx", "mz", "ixx", "izz", "ixy")
JSON: Callable[[Options], Words] = lambda _: ("--json",)  # noqa: E731
PNG: Callable[[Options], Words] = lambda _: ("--png",)  # noqa: E731

OPTIONS: dict[str, tuple[Callable[[Options], Words], ...]] = {
    "excite": (
        lambda o: ("--criterion", o.one_of("d", "condition")),
        lambda o: ("--floor", o.one_of(-50.0, -0.5)),
        lambda o: ("--plot", o.folder / f"planned.{o.one_of('svg', 'png', 'pdf')}"),
        lambda o: ("--trajectory", o.folder / f"points.{o.one_of('yaml', 'json', 'csv', 'script')}"),
        lambda o: ("--trajectory-rate", o.one_of(1, 125, 1000)),
        JSON,
    ),
    "simulate": (lambda o: ("--temperature", o.one_of(-20, 20, 60)), JSON),
    "info": (lambda _: ("--verify",), JSON),
    "plot": (
        lambda o: ("--joint", o.joint()),
        lambda o: ("--joint", o.joint(), "--joint", 1),
        JSON,
    ),
    "import": (
        lambda _: ("--keep-extra",),
        lambda _: ("--time-unit", "s"),
        lambda _: ("--guess",),
        lambda o: ("--save-map", o.folder / "map.toml"),
        JSON,
    ),
    "recover": (lambda _: ("--force",), JSON),
    "identify": (
        lambda o: ("--friction", o.one_of("symmetric", "asymmetric")),
        lambda o: ("--shape", o.one_of("auto", "straight", "free")),
        PNG,
        JSON,
    ),
    "diagnose": (PNG, JSON),
    "calibrate": (
        lambda o: ("--target-std", o.one_of(0.0, 1e-6, 0.1)),
        lambda _: ("--unknown-frame",),
        lambda _: ("--geometry-only",),
        lambda o: ("--memory", o.one_of(1, 500)),
        PNG,
        JSON,
    ),
    "compare": (lambda o: ("--fail-above", o.one_of("10%", "3", "0%", "0", "1e6")), JSON),
    "trend": (lambda o: ("--limit", f"joint{o.joint()}.{o.one_of(*JOINT)}={o.one_of('12', '+50%', '-1')}"), JSON),
}
"""Command -> its options, each drawn with a value."""
