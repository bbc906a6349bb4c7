"""What ``identify`` and ``diagnose`` do with a model whose base floats."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from arm_io import InputError
from armscope.progress import shown


def floats(model: Path | None) -> bool:
    """Whether the base of a model floats; InputError where the file is wrong."""
    from armscope.api.reading import read_model

    return model is not None and read_model(model).floating is not None


def refuse(model: Path | None, options: Mapping[str, bool]) -> None:
    """InputError for the first option that is given and that a floating base has no use for."""
    for option, given in options.items():
        if given:
            raise InputError(option, f"is for arms on a fixed base; {model} has a floating one")


def identify(run: list[Path], model: Path, out: Path, held_out: list[Path], as_json: bool) -> None:
    """Identifies the base, and writes identification.json and model.toml."""
    from armscope.api.floating_base import identify_base

    with shown(as_json) as progress:
        result = identify_base(run, model, held_out=held_out, progress=progress)
        table = result.write(out)
    print(json.dumps(table) if as_json else f"{result}\n{out / 'identification.json'}, model.toml")


def diagnose(fit: list[Path], model: Path, out: Path, held_out: list[Path], as_json: bool) -> None:
    """Diagnoses the base, and writes diagnosis.json and model.toml."""
    from armscope.api.floating_base import diagnose_base

    with shown(as_json) as progress:
        result = diagnose_base(fit, model, held_out=held_out, progress=progress)
        table = result.write(out)
    print(json.dumps(table) if as_json else f"{result}\n{out / 'diagnosis.json'}, model.toml")
