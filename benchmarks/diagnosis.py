"""Time and memory of ``armscope diagnose`` over the length of the recordings, the joints and the causes.

    python -m benchmarks.diagnosis [--json] [--minutes 2 20] [--joints 2 4 6 8] [--causes 0 1 2 3] [--stages]

Each diagnosis is a process of its own, from the command line to the written report: wall time, processor time of
all its threads, and the largest resident set that the operating system saw of it. Two thirds of the minutes are fitted,
one third is held out, in recordings of at most ten minutes at 1000 rows/s.

minutes_M_*      six joints, one cause, M minutes in all
joints_N_*       N joints, one cause, 2 minutes: the Puma without its last joints, or with more joints like its fifth
causes_K_*       six joints, K causes, 2 minutes
*_wall_s, *_cpu_s, *_rss_mb, *_causes_named
stage_S_cpu_s    with --stages: processor time of each stage of a diagnosis of 2 minutes, six joints and one cause, as
                 the progress names them (those of one kind together), its imports before and its report behind;
                 of the processes that it forks too
stage_S_wall_s   wall time of the same
longest_over_linear  processor time per minute of recording of the longest over that of the shortest; 1 or less is
                     linear or better

The arm is simulated by the engine of the project: this measures speed, not whether names are right.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measured_command import longest_over_linear, measured
from benchmarks.report import report


@dataclass(frozen=True)
class Case:
    """What one diagnosis is given."""

    name: str
    minutes: float = 2.0
    joints: int = 6
    causes: int = 1

    def arguments(self, folder: Path) -> list[str]:
        """Of ``benchmarks.diagnosis_recordings``."""
        return [str(folder), str(self.minutes), str(self.joints), str(self.causes)]


def main() -> None:
    """Runs every case and prints the figures."""
    options = _options()
    cases = [Case(f"minutes_{m:g}", minutes=m) for m in options.minutes]
    cases += [Case(f"joints_{n}", joints=n) for n in options.joints]
    cases += [Case(f"causes_{k}", causes=k) for k in options.causes]
    figures: dict[str, float] = {}
    for case in cases:
        print(case.name, file=sys.stderr)
        with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
            figures |= {f"{case.name}_{name}": value for name, value in diagnosed(case, Path(folder)).items()}
    if options.stages:
        with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
            figures |= stages(Case("stages"), Path(folder))
    report(figures | longest_over_linear(figures, options.minutes))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one flat JSON object")
    parser.add_argument("--minutes", type=float, nargs="*", default=[2.0, 20.0])
    parser.add_argument("--joints", type=int, nargs="*", default=[2, 4, 6, 8])
    parser.add_argument("--causes", type=int, nargs="*", default=[0, 1, 2, 3])
    parser.add_argument("--stages", action="store_true", help="processor time of each stage too")
    return parser.parse_args()


def stages(case: Case, folder: Path) -> dict[str, float]:
    """Processor time of the stages of one diagnosis in this process, from its imports to its report."""
    subprocess.run([sys.executable, "-m", "benchmarks.diagnosis_recordings", *case.arguments(folder)], check=True)
    spent: dict[str, float] = {}
    stage, since = "imports", _spent()

    def begins(sentence: str) -> None:
        nonlocal stage, since
        now = _spent()
        for kind, seconds in now.items():
            name = f"stage_{stage}_{kind}_s"
            spent[name] = spent.get(name, 0.0) + seconds - since[kind]
        # what is said for one joint or one file is one of a kind
        stage, since = "_".join(sentence.split(" for ")[0].split(":")[0].split()), now

    from armscope.api.diagnosis import fit_and_held_out
    from armscope.api.reading import fixed_model
    from diagnosis import diagnose
    from diagnosis.report import write_diagnosis

    begins("reading")
    arm = fixed_model(folder / "model.toml", "this")
    fit, held_out, _ = fit_and_held_out(*(sorted(folder.glob(f"{part}_*.mcap")) for part in ("fit", "held_out")))
    begins("screening")
    result = diagnose(arm, fit, held_out, progress=begins)
    begins("tables")
    write_diagnosis(folder / "result", result, fit, held_out, progress=begins)
    begins("end")
    return spent


def _spent() -> dict[str, float]:
    """s of wall time, and of processor time of this process and of those that it has waited for."""
    return {"cpu": sum(os.times()[:4]), "wall": time.perf_counter()}


def diagnosed(case: Case, folder: Path) -> dict[str, float]:
    """Figures of one diagnosis by the command line.

    The operating system counts the parent's memory in, so recordings are made by a process of their own.
    """
    subprocess.run([sys.executable, "-m", "benchmarks.diagnosis_recordings", *case.arguments(folder)], check=True)
    fit, held_out = (sorted(str(path) for path in folder.glob(f"{part}_*.mcap")) for part in ("fit", "held_out"))
    command = ["diagnose", "--model", str(folder / "model.toml"), "--fit", *fit, "--held-out", *held_out]
    figures = measured([*command, "--out", str(folder / "result")])
    found = json.loads((folder / "result/diagnosis.json").read_text(encoding="utf-8"))
    return figures | {"causes_named": len(found["causes"])}


if __name__ == "__main__":
    main()
