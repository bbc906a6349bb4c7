"""``armscope info``: what is in a recording."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from arm_report import line_width, text_table, wrapped
from armscope.commands.options import Json, RecordingArgument
from armscope.progress import shown
from daq.recording import open_long
from daq.recording.losses import loss_lines
from daq.recording.summary import summary, verification_table

_LONGEST = 10
"""Losses and gaps that are shown one by one."""


def command(
    recording: RecordingArgument,
    verify: Annotated[bool, typer.Option("--verify", help="verify the checksum of every record")] = False,
    as_json: Json = False,
) -> int:
    with shown(as_json) as progress:
        table = summary(open_long(recording, damaged=True))
        if verify:
            progress("verifying checksums")
            table["verification"] = verification_table(recording)
    print(json.dumps(table, indent=1) if as_json else wrapped(_text(table)))
    damaged = verify and table["verification"]["damages"]
    return 4 if table["ledger"]["lost"] or table["notes"] or damaged else 0


def _text(table: dict[str, Any]) -> str:
    lines = [table["file"]]
    lines += [f"  ! {note}" for note in table["notes"]]
    lines += _entries(
        kind=table["kind"] + ("" if table["finished"] else ", not finished"),
        rig=table["rig"],
        experiment=table["experiment"],
        start=table["start"],
        ended=((table["run"] or {}).get("ending") or {}).get("sentence"),
        size=f"{table['rows']} rows, {table['duration']:.3f} s, {table['bytes'] / 1e6:.2f} MB",
        rate=_rate(table),
        joints=", ".join(table["joints"]),
        counters=", ".join(table["counters"]),
        inputs=", ".join(table["inputs"]),
        extra=", ".join(table["extra"]),
        samples=_ledger(table["ledger"]),
        checksums=_checksums(table.get("verification")),
    )
    lines += [f"  ! {damage}" for damage in table.get("verification", {}).get("damages", ())]
    lines += _losses(table)
    lines += ["", *(f"  {line}".rstrip() for line in _signals(table["signals"]))]
    flags = {name: count for name, count in (table["quality_flags"] or {}).items() if count}
    if flags:
        lines += [
            "",
            "  flagged values: " + ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in flags.items()),
        ]
    lines += ["", "  topics"] + [f"    {topic['topic']:<22}{topic['type']}" for topic in table["topics"]]
    lines += ["", "  attachments"] + [
        f"    {file['name']:<22}{file['bytes']:>8} bytes  sha256 {file['sha256'][:16]}" for file in table["attachments"]
    ]
    if table["calibration"]:
        lines += ["", f"  calibration {table['calibration'].get('hash', '')}"]
    strings = {key: value for key, value in table["provenance"].items() if isinstance(value, str) and key != "kind"}
    made = {key.replace("_", " "): value for key, value in strings.items()}
    width = max((len(key) for key in made), default=0) + 2
    return "\n".join(lines + ["", "  provenance"] + [f"    {key:<{width}}{value}" for key, value in made.items()])


def _signals(rows: list[dict[str, Any]]) -> list[str]:
    cells = [
        (
            f"{row['signal']}{row['joint'] or ''}",
            row["unit"],
            str(row["missing"]),
            *("-" if row[name] is None else format(row[name], ".5g") for name in ("min", "max", "rms")),
        )
        for row in rows
    ]
    head = ("signal", "unit", "missing", "min", "max", "rms")
    return text_table(cells, head, numbers=range(2, 6), keep=(0, 1), width=line_width() - 2)


def _entries(**entries: str | None) -> list[str]:
    return [f"  {name:<12}{value}" for name, value in entries.items() if value]


def _rate(table: dict[str, Any]) -> str | None:
    if table["rate"] is None:
        return None
    steps = table["intervals"]
    return f"{table['rate']:.6g} Hz (intervals {steps['min'] * 1e3:.4g} to {steps['max'] * 1e3:.4g} ms)"


def _ledger(ledger: dict[str, Any]) -> str:
    balance = "" if ledger["balanced"] else "; THE LEDGER DOES NOT BALANCE"
    return f"{ledger['triggers']} triggers = {ledger['recorded']} recorded + {ledger['lost']} lost{balance}"


def _checksums(verification: dict[str, Any] | None) -> str | None:
    if verification is None:
        return None
    records = f"{verification['records']} records: " if verification["records"] else ""
    return records + verification["sentence"]


def _losses(table: dict[str, Any]) -> list[str]:
    lines = [f"    {line}" for line in loss_lines(table["ledger"]["losses"])]
    pauses = sorted(table["gaps"], key=lambda gap: -gap["seconds"])
    lines += [f"    gap: {gap['seconds']:.4g} s after row {gap['row'] + 1}" for gap in pauses[:_LONGEST]]
    return lines + ([f"    and {len(pauses) - _LONGEST} shorter gaps"] if len(pauses) > _LONGEST else [])
