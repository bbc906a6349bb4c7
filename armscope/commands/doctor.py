"""``armscope doctor``: every device of a rig, what it says it is, what is wrong with it and what to do."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from arm_io import DeviceFault, counted
from armscope.commands.options import Json, RigArgument
from daq.rig import Bench, DeviceTable, check_plan, read_rig
from daq.service import RigLock
from drivers import find_devices
from drivers.protocols import Device, EdgeSource, Identity, Latched, Plan, Polled, Quality

TRIAL = 0.3
"""s of rows from every device that makes them without the start line."""
MOST_DOUBTFUL = 0.1
"""Share of a column's values."""
WORRIES = {
    Quality.MISSING: "check its cable and supply",
    Quality.STALE: "it is polled faster than it measures",
    Quality.SATURATED: "check its wiring and range",
    Quality.QUADRATURE_ERROR: "check the encoder's two lines and their shield",
}


def command(
    rig: RigArgument,
    as_json: Json = False,
) -> int:
    checked = read_rig(rig)
    bench = Bench(checked)
    lock = RigLock(checked.name, "doctor")
    identities: dict[str, Identity] = {}
    findings = []
    try:
        plan = Plan(bench.trigger.source, bench.trigger.rate, None)
        for table in checked.device:
            findings.append(_examine(table, bench.devices[table.name], identities, plan))
        problems = check_plan(checked, bench.devices, identities, plan) if len(identities) == len(findings) else []
    finally:
        for device in bench.devices.values():
            device.close()
        lock.release()
    healthy = not problems and not any(finding["problems"] for finding in findings)
    if as_json:
        result: dict[str, Any] = {"schema": "armscope.doctor/1", "rig": checked.name, "healthy": healthy}
        print(json.dumps(result | {"devices": findings, "problems": problems}, indent=1))
    else:
        print("\n".join(_text(checked.name, findings, problems)))
    return 0 if healthy else 3


def _examine(table: DeviceTable, device: Device, identities: dict[str, Identity], plan: Plan) -> dict[str, Any]:
    """The report of one device, opened alone, so that one missing device does not hide the others.

    If it does not answer, the report names the devices that were found instead.
    """
    finding: dict[str, Any] = {"device": table.name, "identity": None, "problems": [], "found": []}
    try:
        identities[table.name] = device.open()
        finding["identity"] = asdict(identities[table.name])
        finding["problems"] += device.check() or _try_out(device, plan)
    except DeviceFault as fault:
        finding["problems"].append(fault.what)
        if table.name not in identities:
            finding["found"] = find_devices(table.driver, table.options, table.name)
    return finding


def _try_out(device: Device, plan: Plan) -> list[str]:
    """Problems with a few rows of a device that makes rows without the start line, at the rig's rate.

    It checks whether rows arrive and hold values.
    """
    if plan.source is EdgeSource.TRACKER or not isinstance(device, Polled | Latched):
        return []
    device.arm(plan)
    try:
        blocks, end = [], time.monotonic() + TRIAL
        while time.monotonic() < end:
            blocks.append(device.poll() if isinstance(device, Polled) else device.read())
            time.sleep(1 / plan.rate if isinstance(device, Polled) else plan.block_seconds)
    finally:
        device.disarm()
    quality = [block.quality for block in blocks if len(block)]
    if not quality:
        return [f"made no rows in {TRIAL:g} s: check its clock"]
    rows = np.concatenate(quality)
    share = {flag: (rows & np.uint8(flag) != 0).mean(axis=0) for flag in WORRIES}
    return [
        f"column {column + 1} of {rows.shape[1]}: {part:.0%} of its values are {str(flag.name).lower()}, "
        f"{WORRIES[flag]}"
        for flag, parts in share.items()
        for column, part in enumerate(parts)
        if part > MOST_DOUBTFUL
    ]


def _text(rig: str, findings: list[dict[str, Any]], problems: list[str]) -> list[str]:
    lines = [f"rig {rig}"]
    for finding in findings:
        identity = finding["identity"]
        lines.append(f"  {'ok   ' if not finding['problems'] else 'FAULT'} {finding['device']}: {_describe(identity)}")
        lines += [f"        {problem}" for problem in finding["problems"]]
        if identity is not None and "unconfirmed" in identity["details"]:
            lines.append(f"        not confirmed on a real device: {identity['details']['unconfirmed']}")
        lines += [f"        there is {place}" for place in finding["found"]]
    lines += [f"  FAULT {problem}" for problem in problems]
    faults = sum(bool(finding["problems"]) for finding in findings) + len(problems)
    return lines + [
        f"{counted(len(findings), 'device')}, " + ("all is well" if not faults else f"{faults} with faults")
    ]


def _describe(identity: dict[str, Any] | None) -> str:
    if identity is None:
        return "no answer"
    words = [identity["maker"], identity["model"]]
    words += [f"serial {identity['serial']}"] if identity["serial"] else []
    words += [f"firmware {identity['firmware']}"] if identity["firmware"] else []
    if identity["max_rate"] is not None:
        words.append(f"at most {identity['max_rate']:g} rows/s")
    return ", ".join(words)
