"""The arm with faults to try a diagnosis on is the nominal one but for its faults, on the rig of the nominal one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from arm_model.model_file import read_model
from daq.rig.rig_file import read_rig


def test_worn_arm_is_the_nominal_one_with_effects(root: Path) -> None:
    worn, nominal = (read_model(root / f"config/models/{name}.toml") for name in ("puma560_worn", "puma560"))
    assert len(worn.effects) == 3
    assert replace(worn, effects=(), source=nominal.source) == nominal


def test_worn_rig_is_the_simulated_one_with_another_arm(root: Path) -> None:
    worn, plain = (read_rig(root / f"config/{name}.toml", drivers=False) for name in ("puma560_worn", "puma560_sim"))
    assert str(worn.simulation["model"]).endswith("puma560_worn.toml")
    own = {"name", "description", "block_seconds", "simulation"}
    assert worn.model_dump(exclude=own) == plain.model_dump(exclude=own)
    assert {k: v for k, v in worn.simulation.items() if k not in ("model", "pace")} == {
        k: v for k, v in plain.simulation.items() if k != "pace"
    }
