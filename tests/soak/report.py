"""The account of a soak, judged, as JSON and as a section for docs/endurance.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.soak.rig import RATE
from tests.soak.soak import MOST_GROWTH, WARM_UP, Account

Table = dict[str, Any]


def growth_of(life: list[tuple[float, float]]) -> float | None:
    """MB by which memory rose between first and last quarter of the time after the first minute.

    None if that is too short.
    """
    after = [megabytes for seconds, megabytes in life if seconds > WARM_UP]
    quarter = len(after) // 4
    return None if quarter < 2 else float(np.median(after[-quarter:]) - np.median(after[:quarter]))


def as_table(account: Account, seconds: float) -> Table:
    """``soak.json``: what was done, what was lost, what was wrong."""
    growth = [growth_of(life) for life in account.memory]
    wrong = account.wrong + [
        f"memory rose by {rise:.1f} MB after its first minute"
        for rise in growth
        if rise is not None and rise > MOST_GROWTH
    ]
    return {
        "schema": "armscope.soak/1",
        "seconds": round(seconds),
        "wrong": wrong,
        "runs": dict(account.runs),
        "ends": dict(account.ends),
        "triggers": account.triggers,
        "recorded": account.recorded,
        "lost": dict(account.lost),
        "subscriber": dict(account.subscriber),
        "killed_ms": [round(1e3 * rows / RATE) for rows in account.killed_rows],
        "disk_delays": account.delays,
        "slowest_answer_s": round(account.slowest_answer, 3),
        "memory_mb": [[(round(s), round(m, 1)) for s, m in life] for life in account.memory],
        "memory_growth_mb": [None if rise is None else round(rise, 1) for rise in growth],
        "crowd": account.crowd,
    }


def section(table: Table) -> str:
    """The same for people."""
    runs = ", ".join(f"{count} {kind}" for kind, count in sorted(table["runs"].items()))
    lost = ", ".join(f"{rows} {reason}" for reason, rows in sorted(table["lost"].items()))
    crowd = "; ".join(
        f"{guest['kind']}: "
        + ", ".join(f"{value} {what}" for what, value in guest.items() if what not in ("kind", "slowest"))
        for guest in table["crowd"]
    )
    rises = [rise for rise in table["memory_growth_mb"] if rise is not None]
    first, last = table["memory_mb"][0][0][1], table["memory_mb"][-1][-1][1]
    memory = f"{first} MB at the beginning, {last} MB at the end"
    if rises:
        memory += f"; after its first minute each daemon rose by {max(rises)} MB at most"
    lines = [
        f"{table['seconds'] / 60:.0f} minutes at 20 kHz. Runs: {runs}.",
        "",
        "| what | figure |",
        "|---|---|",
        f"| triggers = rows recorded + rows lost | {table['triggers']} = {table['recorded']} + "
        f"{sum(table['lost'].values())} |",
        f"| lost, by reason | {lost or 'none'} |",
        f"| kill -9: rows fewer than the daemon last reported, ms | {table['killed_ms']} |",
        f"| a healthy subscriber: rows received, missed | {table['subscriber'].get('rows', 0)}, "
        f"{table['subscriber'].get('missed', 0)} |",
        f"| slowest answer to `status`, `start`, `stop` | {table['slowest_answer_s']} s |",
        f"| memory of the daemon between runs | {memory} |",
        f"| the crowd | {crowd} |",
        f"| wrong | {'; '.join(table['wrong']) or 'nothing'} |",
    ]
    return "\n".join(lines) + "\n"


def write(folder: Path, table: Table) -> None:
    """``soak.json`` and ``soak.md`` in ``folder``."""
    (folder / "soak.json").write_text(json.dumps(table, indent=1) + "\n")
    (folder / "soak.md").write_text(section(table))
