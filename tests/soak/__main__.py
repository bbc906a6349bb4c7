"""``python -m tests.soak [--minutes 10 | --hours 12] [--seed N] [--out DIR]``.

Status 0 where nothing was wrong, else 1.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.soak.report import as_table, section, write
from tests.soak.soak import Soak

ROOT = Path(__file__).parents[2]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--hours", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("soak"), help="soak.json and soak.md go there")
    options = parser.parse_args()
    seconds = 60 * options.minutes if options.hours is None else 3600 * options.hours
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="armscope-soak-") as folder:
        soak, begun = Soak(ROOT, Path(folder), options.seed), time.monotonic()
        try:
            soak.go(seconds)
        finally:
            table = as_table(soak.account, time.monotonic() - begun)
            write(options.out, table)
            print(section(table))
    return 1 if table["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
