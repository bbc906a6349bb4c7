"""``armscope doctor``: every device of a rig, what it says it is, what is wrong with it and what to do."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.arming import check_plan
from daq.bench import Bench
from daq.rig import read_rig
from daq.rig_lock import RigLock
from drivers.shapes import Device, Identity, Plan
from inputs import DeviceFault


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="the rig")],
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> int:
    checked = read_rig(rig)
    lock = RigLock(checked.name, "doctor")
    bench = Bench(checked)
    identities: dict[str, Identity] = {}
    findings = []
    try:
        for name, device in bench.devices.items():
            findings.append(_examine(name, device, identities))
        plan = Plan(bench.trigger.source, bench.trigger.rate, None)
        problems = check_plan(checked, bench.devices, identities, plan) if len(identities) == len(findings) else []
    finally:
        for device in bench.devices.values():
            device.close()
        lock.release()
    healthy = not problems and not any(finding["problems"] for finding in findings)
    if as_json:
        table = {"schema": "armscope.doctor/1", "rig": checked.name, "healthy": healthy}
        print(json.dumps(table | {"devices": findings, "problems": problems}, indent=1))
    else:
        print("\n".join(_text(checked.name, findings, problems)))
    return 0 if healthy else 3


def _examine(name: str, device: Device, identities: dict[str, Identity]) -> dict[str, Any]:
    """What a device says, opened by itself so that one that is missing hides no other."""
    finding: dict[str, Any] = {"device": name, "identity": None, "problems": []}
    try:
        identities[name] = device.open()
        finding["identity"] = asdict(identities[name])
        finding["problems"] += device.check()
    except DeviceFault as fault:
        finding["problems"].append(fault.what)
    return finding


def _text(rig: str, findings: list[dict[str, Any]], problems: list[str]) -> list[str]:
    lines = [f"rig {rig}"]
    for finding in findings:
        identity = finding["identity"]
        lines.append(f"  {'ok   ' if not finding['problems'] else 'FAULT'} {finding['device']}: {_describe(identity)}")
        lines += [f"        {problem}" for problem in finding["problems"]]
    lines += [f"  FAULT {problem}" for problem in problems]
    faults = sum(bool(finding["problems"]) for finding in findings) + len(problems)
    return lines + [f"{len(findings)} devices, " + ("all is well" if not faults else f"{faults} with faults")]


def _describe(identity: dict[str, Any] | None) -> str:
    if identity is None:
        return "no answer"
    words = [identity["maker"], identity["model"]]
    words += [f"serial {identity['serial']}"] if identity["serial"] else []
    words += [f"firmware {identity['firmware']}"] if identity["firmware"] else []
    if identity["max_rate"] is not None:
        words.append(f"at most {identity['max_rate']:g} rows/s")
    return ", ".join(words)
