"""``python -m tests.foreign``: 500 random arms, each through every command; crashes, and refusals by their kind."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
from collections import Counter
from concurrent.futures import as_completed
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.executors import executor
from tests.foreign.commands import through_every_command
from tests.foreign.ended import Ended, bound_memory, kind, unrendered
from tests.foreign.spoiled import through_spoiled_files

RENDERED = 10
"""Every tenth arm has its pictures drawn; of the others they are composed only."""


def main() -> int:
    options = _options()
    seeds = range(options.seed, options.seed + options.arms)
    crashed: set[int] = set()
    crashes, refusals = Counter[str](), Counter[str]()
    ended = 0
    with executor(options.workers, options.scheduler) as pool:
        running = {pool.submit(of_arm, seed, options.spoiled): seed for seed in seeds}
        for number, done in enumerate(as_completed(running), 1):
            seed, (several, seconds) = running[done], done.result()
            ended += len(several)
            bad = [one for one in several if not one.well]
            crashes.update(map(kind, bad))
            refusals.update(kind(one) for one in several if one.well and one.status)
            crashed |= {seed} if bad else set()
            print(f"{number:4}/{len(seeds)} arm {seed}: {len(several)} commands, {seconds:.0f} s", flush=True)
            for one in bad:
                print(f"  CRASH {one.command}\n{one.said}", flush=True)
    figures = {
        "arms": len(seeds),
        "commands": ended,
        "arms_with_a_crash": len(crashed),
        "crashes": sum(crashes.values()),
        "refused": sum(refusals.values()),
    }
    for title, kinds in (("crashes", crashes), ("refusals", refusals)):
        print(f"\n{title} by kind:")
        for line, count in kinds.most_common():
            print(f"{count:6} {line}")
    print(f"\nseeds {seeds[0]} to {seeds[-1]}: {json.dumps(figures)}\nwith a crash: {sorted(crashed)}")
    return 1 if crashed else 0


def of_arm(seed: int, spoiled: int) -> tuple[list[Ended], float]:
    """How every command on one arm ended, and on so many spoiled copies of its files; the s of processor time."""
    began = time.process_time()
    bound_memory()
    with TemporaryDirectory() as folder:
        several: list[Ended] = []
        try:
            if seed % RENDERED:
                with unrendered():
                    several += through_every_command(seed, Path(folder))
            else:
                several += through_every_command(seed, Path(folder))
            several += through_spoiled_files(seed, Path(folder), spoiled) if spoiled else ()
        except Exception:
            several.append(Ended(f"generator {seed}", None, traceback.format_exc()))
    return several, time.process_time() - began


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.foreign", description=__doc__)
    parser.add_argument("--arms", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0, help="of the first arm; the others follow")
    parser.add_argument(
        "--spoiled", type=int, default=0, metavar="N", help="also N spoiled copies of each of its files"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="instead: the workers of a Dask scheduler")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
