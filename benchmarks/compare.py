"""Time and memory of ``armscope compare`` over the length of the recordings, the joints and what changed.

    python -m benchmarks.compare [--json] [--minutes 2 20] [--joints 2 4 6 8] [--causes 0 1 2 3] [--recordings 1]

Each comparison is a process of its own, from the command line to the written report. Its recordings, at 1000 rows/s,
are those of ``benchmarks.diagnosis_recordings``: of the arm before, and with causes after.

minutes_M_*      six joints, nothing changed, M minutes in all, a half on each side
joints_N_*       N joints, one change, 2 minutes
causes_K_*       six joints, K changes, 2 minutes
*_wall_s, *_cpu_s, *_rss_mb  wall time, processor time of all its threads, and largest resident set
*_significant    changes that are named
longest_over_linear  processor time per minute of the longest over that of the shortest; 1 or less is linear or better

``--recordings``: per side, of the same minutes. The arm is simulated by the engine of the project: this measures speed,
not whether changes are right.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.measured_command import longest_over_linear, measured
from benchmarks.report import report

SIDES = ("before", "after")


def main() -> None:
    """Runs every case and prints the figures; with --make, makes the recordings of one."""
    options = _options()
    if options.make:
        folder, minutes, joints, causes = options.make
        recordings(Path(folder), float(minutes), int(joints), int(causes), options.recordings)
        return
    cases = {f"minutes_{m:g}": (m, 6, 0) for m in options.minutes}
    cases |= {f"joints_{n}": (2.0, n, 1) for n in options.joints}
    cases |= {f"causes_{k}": (2.0, 6, k) for k in options.causes}
    figures: dict[str, float] = {}
    for name, case in cases.items():
        print(name, file=sys.stderr)
        with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
            # the operating system counts the parent's memory in: recordings are made by a process of their own
            made = [str(one) for one in (folder, *case)]
            per_side = ["--recordings", str(options.recordings)]
            subprocess.run([sys.executable, "-m", "benchmarks.compare", "--make", *made, *per_side], check=True)
            figures |= {f"{name}_{key}": value for key, value in compared(Path(folder)).items()}
    report(figures | longest_over_linear(figures, options.minutes))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one flat JSON object")
    parser.add_argument("--minutes", type=float, nargs="*", default=[2.0, 20.0])
    parser.add_argument("--joints", type=int, nargs="*", default=[2, 4, 6, 8])
    parser.add_argument("--causes", type=int, nargs="*", default=[0, 1, 2, 3])
    parser.add_argument("--recordings", type=int, default=1, help="per side")
    parser.add_argument("--make", nargs=4, metavar=("FOLDER", "MINUTES", "JOINTS", "CAUSES"), help="recordings alone")
    return parser.parse_args()


def recordings(folder: Path, minutes: float, joints: int, causes: int, per_side: int) -> None:
    """Writes FOLDER/model.toml, before_*.mcap and, with the causes, after_*.mcap."""
    from arm_model import write_model
    from benchmarks.diagnosis_recordings import CAUSES, chain, write

    arm, random = chain(joints), np.random.default_rng(1)
    write_model(folder / "model.toml", arm)
    changed = replace(arm, effects=(*arm.effects, *CAUSES[:causes]))
    for side, one in zip(SIDES, (arm, changed)):
        for number in range(per_side):
            write(one, folder / f"{side}_{number}.mcap", 30.0 * minutes / per_side, random)


def compared(folder: Path) -> dict[str, float]:
    """Figures of one comparison by the command line."""
    sides = [",".join(sorted(str(path) for path in folder.glob(f"{side}_*.mcap"))) for side in SIDES]
    command = ["compare", *sides, "--model", str(folder / "model.toml"), "--out", str(folder / "result")]
    figures = measured(command)
    found = json.loads((folder / "result/compare.json").read_text(encoding="utf-8"))
    return figures | {"significant": sum(one["significant"] for one in found["changes"])}


if __name__ == "__main__":
    main()
