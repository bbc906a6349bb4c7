"""What M. Abderrahim saw in his recordings and not in his simulation, and what armscope says of it.

    python -m examples.vertical [--out DIR]

When link 2 of the Puma passed the vertical, the current of joint 2 jumped, and with it that of joint 3, which rested
(thesis, chapter 4). He took it for backlash in the gears, which his model did not have. Here link 2 of the simulated
Puma gets a gap of 2 mrad between motor and link. Runs 5 to 8 of the thesis are recorded through encoders, transducers
and converters; both speeds at 100 % fit, both at 50 % are held out; the model of the rig knows nothing of the gap.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import armscope
from arm_model import Arm, EffectTerm, read_model, write_model

CONFIG = Path(__file__).resolve().parent.parent / "config"
FIT = ("thesis_07_joint2_100_forward", "thesis_08_joint2_100_back")
HELD_OUT = ("thesis_05_joint2_50_forward", "thesis_06_joint2_50_back")
HALF_GAP = 1e-3  # rad


def with_gap(arm: Arm) -> Arm:
    gap = {"half_gap": HALF_GAP, "contact_stiffness": 2e5, "contact_damping": 50.0}
    return replace(arm, effects=(EffectTerm("backlash", 2, gap),))


def rig(out: Path) -> Path:
    """The simulated laboratory at the fast pace; its arm has the gap, its model has not."""
    nominal = CONFIG / "models/puma560.toml"
    write_model(out / "gap.toml", with_gap(read_model(nominal)))
    text = (CONFIG / "puma560_worn.toml").read_text()
    text = text.replace('"models/puma560.toml"', f'"{nominal}"').replace('"models/puma560_worn.toml"', '"gap.toml"')
    file = out / "rig.toml"
    file.write_text(text)
    return file


def draw(runs: list[Path], out: Path) -> Path:
    """Currents of joints 2 and 3 over the angle of joint 2, measured and expected."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(9, 6), sharex=True, layout="constrained")
    for file in runs:
        run = armscope.open(file)
        for axis, joint in zip(axes, (1, 2)):
            axis.plot(np.degrees(run.q[:, 1]), run.i[:, joint], linewidth=0.6, label=file.stem)
            axis.set_ylabel(f"current of joint {joint + 1}, A")
    axes[0].legend()
    axes[1].set_xlabel("joint 2, deg")
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.savefig(out / "vertical.png", dpi=110)
    return out / "vertical.png"


def main(out: Path) -> None:
    laboratory = rig(out)
    runs = {
        name: armscope.record(laboratory, CONFIG / f"experiments/{name}.toml", out / f"{name}.mcap").file
        for name in (*FIT, *HELD_OUT)
    }
    verdict = armscope.diagnose(
        [runs[name] for name in FIT], CONFIG / "models/puma560.toml", held_out=[runs[name] for name in HELD_OUT]
    )
    print(verdict)
    print(draw([runs[name] for name in FIT], out))
    verdict.write(out / "verdict")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("vertical"), help="folder for recordings, picture and report")
    chosen = parser.parse_args().out
    chosen.mkdir(parents=True, exist_ok=True)
    main(chosen)
