"""``armscope fleet-sim``: recordings of a simulated fleet whose arms wear, with the truth beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arm_io import check_folder
from arm_io.json_text import json_text
from armscope.commands.options import Json
from armscope.progress import shown
from armscope.shipped import found

MODEL = "config/models/two_link.toml"


def command(
    out: Annotated[
        Path, typer.Argument(metavar="DIR", help="folder for recordings, model.toml, plan.toml, truth.json")
    ],
    arms: Annotated[int, typer.Option(min=1, max=100_000, help="number of arms")] = 8,
    nights: Annotated[int, typer.Option(min=1, max=10_000, help="number of nights")] = 30,
    worn: Annotated[
        float, typer.Option(min=0, max=1, help="share of arms that wear; every second one of them is repaired")
    ] = 0.5,
    seconds: Annotated[float, typer.Option(min=4, max=3600, help="duration of one recording, s")] = 12.0,
    seed: Annotated[int, typer.Option(min=0, help="seed of wear and noise")] = 1,
    model: Annotated[
        Path, typer.Option(metavar="MODEL.toml", help="model of all arms; must have a [controller]")
    ] = Path(MODEL),
    temperature_std: Annotated[
        float,
        typer.Option(min=0, max=30, help="std of an arm's temperature from night to night, K; friction follows it"),
    ] = 0.0,
    season: Annotated[
        float, typer.Option(min=-60, max=60, help="rise of all temperatures from the first night to the last, K")
    ] = 0.0,
    noise_correlation: Annotated[
        float, typer.Option(min=0, max=10, help="correlation time of the current noise, s; 0: white")
    ] = 0.0,
    as_json: Json = False,
) -> None:
    """Writes a fleet."""
    from arm_fleet import Scene, lives, write_fleet
    from armscope.api.reading import read_model

    check_folder(out)
    arm = read_model(found(model))
    scene = Scene(arm=arm, seconds=seconds, temperature=temperature_std, season=season, correlation=noise_correlation)
    with shown(as_json) as progress:
        truth = write_fleet(out, scene, lives(arms, nights, worn=worn, seed=seed), nights, seed=seed, progress=progress)
    if as_json:
        print(json_text(truth))
        return
    for one in truth["arms"]:
        if one["wear"]:
            repaired = f", repaired {one['repaired']}" if one["repaired"] else ""
            print(f"{one['arm']}: {one['wear']} from {one['begins']}, visible {one['visible'] or 'never'}{repaired}")
    print(f"{arms} arms, {nights} nights; next: armscope fleet {out / 'plan.toml'} --out {out / 'results'}")
