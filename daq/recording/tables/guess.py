"""A guess at the mapping of a foreign table, from the names of its columns; a person decides whether it is right."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.files import read_head
from arm_io.types import Array
from daq.recording.tables.csv_header import LONGEST_HEADER, SAMPLE, cells_of, encoding_of, names_of
from daq.recording.tables.mapping import TORQUES, UNITS, Mapping

KNOWN: dict[str, dict[str, dict[str, str]]] = {
    "Universal Robots RTDE": {
        "columns": {
            "t": "timestamp",
            "q": "actual_q_{0}",
            "i": "actual_current_{0}",
            "qref": "target_q_{0}",
            "temp": "joint_temperatures_{0}",
        },
        "units": {"i": "A"},
    },
    "libfranka": {
        "columns": {"t": "time", "q": "state.q[{0}]", "i": "state.tau_J[{0}]", "qref": "state.q_d[{0}]"},
        "units": {"t": "ms", "i": "N m"},
    },
    "libfranka before 0.10": {
        "columns": {"t": "duration", "q": "q[{0}]", "i": "tau_J[{0}]", "qref": "q_d[{0}]"},
        "units": {"t": "ms", "i": "N m"},
    },
    "PlotJuggler, of a JointState": {
        "columns": {"t": "__time", "q": "/joint_states/position[{0}]", "i": "/joint_states/effort[{0}]"},
        "units": {"i": "N m"},
    },
}
"""Program -> the mapping of what it writes; t, q and i must be there, the others may be."""
_TIME = re.compile(
    r"(time|timestamp|t|tout|sec|seconds|stamp|clock|elapsed([ _]*time)?|zeit(stempel)?|temps|tiempo|tempo)"
    r"(?:[ _]*[\[(]?(?P<unit>s|sec|ms|us|ns)[\])]?)?",
    re.IGNORECASE,
)
PLOTJUGGLER_TIME = "__time"
_OF_TOPIC = re.compile(r"(?P<topic>/.+)/(?P<joint>[^/]+)/(?P<field>position|effort)")
_DEMANDS = re.compile(r"demand|command|desired|reference|target|setpoint|goal", re.IGNORECASE)
POSITION = "q|pos|positions?|angles?|joint|winkel"
_MEASURED = "([ _.]*(meas(ured)?|act(ual)?|feedback|fbk?))?"
_JOINT = "joint|axis|achse|gelenk"
_WORDS = {
    "qref": rf"(({POSITION})?[ _.]*(ref|reference|demand(ed)?|target|goal|setpoint|desired|des|cmd|command(ed)?)[ _.]*"
    rf"({POSITION})?|q_d|soll[ _.-]*(wert|position|winkel)?)",
    "ql": r"(link|load|output)[ _.]*(side)?[ _.]*(q|pos|position|angle|encoder)",
    "i": r"(i|joint[ _.]*(currents?|torques?|efforts?)|cur|curr|currents?|motor[ _.]*currents?|actual[ _.]*current"
    rf"|tau(_J)?|torques?|forces?|effort|actual[ _.]*torque|strom|motorstrom|drehmoment|kraft){_MEASURED}",
    "v": r"(v|volt|voltage|motor[ _.]*voltage)",
    "temp": r"(temp|temperature|motor[ _.]*temperature)",
    "q": r"(q|j|pos|positions?|angles?|winkel|weg|hub|stroke|theta|joint|axis|actual[ _.]*(q|pos|position)"
    rf"|joint[ _.]*(pos|positions?|angles?)|ist[ _.-]*(wert|position|winkel)?){_MEASURED}",
}
_UNIT = (
    r"(?P<unit>[ _]*[\[(]?(rad|deg|degrees|grad|°|mA|A|%|Nm|N m|N\*m|V|C|degC)[\])]?|[ _]*[ _\[(](mm|cm|m|N)[\])]?)?"
)
_SPELLED = {"degrees": "deg", "Grad": "deg", "grad": "deg", "°": "deg", "Nm": "N m", "N*m": "N m", "C": "degC"}
_ANY = r"(?P<word>[^\d\[(]*[^\W\d_])"
_TOLD_BY = {"q": {"rad", "deg"}, "i": {"mA", "A", "N m", "N"}}
"""Signal -> units of it alone, by which its columns are told where their word is of no language that is known here."""
_COMMA = re.compile(r"\s*-?\d+,\d+(e-?\d+)?\s*")
_Units = str | list[str]
_Series = tuple[list[str], _Units]
"""Columns, one per joint, and their unit, or one per column; "" without."""
_BETWEEN = "[ _./:-]+"


def guess(names: Sequence[str], columns: dict[str, Array] | None = None, joints: Sequence[str] = ()) -> Mapping | None:
    """The mapping that the names of a table suggest; None where they say too little.

    columns  numbers of some rows: positions beyond two turns are taken for degrees
    joints   names of the arm's joints: their order, where columns are named by joints
    """
    for table in KNOWN.values():
        mapping = _known(names, table)
        if mapping is not None:
            return mapping
    return _from_topics(names, joints) or _from_words(names, columns or {}, joints)


def guess_csv(path: str | Path, joints: Sequence[str]) -> Mapping | None:
    """The mapping that a text suggests, with its separator and decimal sign; None where it says too little.

    InputError where the first line is no header, or some of its joints have a position without a current.
    """
    head = read_head(path, SAMPLE)
    # lines end as Python's files have it: \n, \r\n, or \r
    with io.StringIO(head.decode(encoding_of(path), errors="replace"), newline=None) as text:
        lines = [line.strip() for line in text.read().split("\n")]
    # the last line of a part of a text is part of a line
    lines = lines if len(head) < SAMPLE else lines[:-1]
    if not lines or len(lines[0]) > LONGEST_HEADER:
        raise InputError(path, f"line 1: must name the columns, in at most {LONGEST_HEADER} characters")
    for separator in ";\t|,":
        found = _guess_separated(lines, separator, joints)
        if found is not None:
            return found
    for separator in ";\t|,":
        if odd := _unpaired(names_of(lines, separator)[0]):
            raise InputError(
                path, f"line 1: every joint needs a position and a current; {odd}; --map says which is which"
            )
    return _guess_separated(lines, " ", joints)


def _guess_separated(lines: Sequence[str], separator: str, joints: Sequence[str]) -> Mapping | None:
    """The mapping that the lines of a text suggest if this separates their cells.

    None where the first row does not have as many cells as there are names.
    """
    names, before = names_of(lines, separator)
    rows = [cells_of(line, separator) for line in lines[before:] if line]
    if rows and _named(rows[0]) != _named(names):
        return None
    commas = separator != "," and any(_COMMA.fullmatch(cell) for row in rows for cell in row)
    decimal = "," if commas else "."
    numbers = {
        name: np.array([_number(row[place].replace(decimal, ".")) for row in rows if place < len(row)])
        for place, name in enumerate(names)
    }
    found = guess(names, numbers, joints)
    return found and found.model_copy(update={"separator": separator, "decimal": decimal})


def _named(cells: Sequence[str]) -> int:
    """Number of cells, without an empty one where a line ends in a separator."""
    return len(cells) - (not cells[-1]) if cells else 0


def _known(names: Sequence[str], table: dict[str, dict[str, str]]) -> Mapping | None:
    there = set(names)
    columns = {signal: column for signal, column in table["columns"].items() if column.replace("{0}", "0") in there}
    if not {"t", "q", "i"} <= set(columns):
        return None
    return Mapping.model_validate({"columns": columns, "units": table.get("units", {})})


def _from_topics(names: Sequence[str], joints: Sequence[str]) -> Mapping | None:
    """Of PlotJuggler's TOPIC/JOINT/position, TOPIC/JOINT/effort; a topic of demands with the same joints is qref."""
    topics: dict[str, dict[str, dict[str, str]]] = {}
    for name in names:
        if match := _OF_TOPIC.fullmatch(name):
            topics.setdefault(match["topic"], {}).setdefault(match["joint"], {})[match["field"]] = name
    moved = {
        topic: [joint for joint, fields in found.items() if {"position", "effort"} <= set(fields)]
        for topic, found in topics.items()
    }
    topic = max(moved, key=lambda one: len(moved[one]), default="")
    if PLOTJUGGLER_TIME not in names or not (there := moved.get(topic)):
        return None
    order = [joint for joint in joints if joint in there] if set(joints) & set(there) else there
    columns: dict[str, Any] = {
        "t": PLOTJUGGLER_TIME,
        "q": [topics[topic][joint]["position"] for joint in order],
        "i": [topics[topic][joint]["effort"] for joint in order],
    }
    for other, found in topics.items():
        if _DEMANDS.search(other) and all("position" in found.get(joint, {}) for joint in order):
            columns["qref"] = [found[joint]["position"] for joint in order]
    return Mapping.model_validate({"columns": columns, "units": {"i": "N m"}})


def _from_words(names: Sequence[str], numbers: dict[str, Array], joints: Sequence[str]) -> Mapping | None:
    """The columns whose names are words for a signal and numbers, or words and names of joints."""
    time = _times(names, numbers)
    columns: dict[str, Any] = {}
    units: dict[str, _Units] = {}
    taken: set[str] = set()
    first: dict[str, int] = {}
    if time:
        columns["t"], of_time = time[0][0], time[0][1]["unit"]
        units |= {"t": of_time.lower().replace("sec", "s")} if of_time else {}
    for signal, word in _WORDS.items():
        series = _of_joints([name for name in names if name not in taken], signal, word)
        if series is not None:
            columns[signal], unit, first[signal] = series
            taken |= set(columns[signal])
            units |= {signal: unit} if unit else {}
    for signal in _TOLD_BY.keys() - columns.keys() if "t" in columns else ():
        if (series := _by_unit([name for name in names if name not in taken], signal)) is not None:
            columns[signal], units[signal], first[signal] = series
            taken |= set(columns[signal])
    # signals numbered from 0 and from 1 do not belong to the same joints
    for signal in [one for one, number in first.items() if number != first.get("q", number)]:
        del columns[signal]
        units.pop(signal, None)
    if "t" in columns and not {"q", "i"} & set(columns):
        named = _of_named_joints([name for name in names if name != columns["t"]], joints)
        columns |= {signal: series for signal, (series, _) in named.items()}
        units |= {signal: unit for signal, (_, unit) in named.items() if unit}
    paired = _of_paired_words(names, joints)
    if "t" in columns and "q" in paired and len(paired["q"][0]) > len(columns.get("q", ())):
        columns = {"t": columns["t"]} | {signal: series for signal, (series, _) in paired.items()}
        units = {one: unit for one, unit in units.items() if one == "t"}
        units |= {signal: unit for signal, (_, unit) in paired.items()}
    efforts = units.get("i", "")
    mixed = isinstance(efforts, list) and not TORQUES.isdisjoint(efforts) and not TORQUES.issuperset(efforts)
    if not {"t", "q", "i"} <= set(columns) or mixed:
        return None
    for signal in {"q", "qref", "ql"} & set(columns) - set(units):
        values = [numbers[name] for name in columns[signal] if name in numbers]
        if any(np.nanmax(np.abs(one), initial=0.0) > 4 * np.pi for one in values):
            units[signal] = "deg"
    if re.search("tau|torque|force|effort|drehmoment|kraft", " ".join(columns["i"]), re.IGNORECASE):
        units.setdefault("i", "N m")
    return Mapping.model_validate({"columns": columns, "units": units})


def _times(names: Sequence[str], numbers: dict[str, Array]) -> list[tuple[str, re.Match[str]]]:
    """Columns whose names are words for the time; else fields of structures, where all that are have the same times."""
    found = [(name, match) for name in names if (match := _TIME.fullmatch(name.strip()))]
    if found:
        return found
    fields = [(name, match) for name in names if (match := _TIME.fullmatch(name.rpartition(".")[2].strip()))]
    first, *others = [numbers.get(name) for name, _ in fields] or [None]
    same = first is not None and all(one is not None and np.array_equal(one, first) for one in others)
    return fields if same else []


def _units(signal: str, written: Sequence[str]) -> _Units:
    """The unit of a signal's columns, of each column where they differ; "" where no column states one.

    A column that states none has that of all others, or the first of ``UNITS``.
    """
    spelled = [_SPELLED.get(unit, unit) for unit in (one.strip(" _[]()") for one in written)]
    stated = {unit for unit in spelled if unit}
    return (stated or {""}).pop() if len(stated) < 2 else [unit or next(iter(UNITS[signal])) for unit in spelled]


def _of_joints(names: Sequence[str], signal: str, word: str) -> tuple[list[str], _Units, int] | None:
    """The columns whose names are a word with a number, in the order of their numbers; their unit and first number."""
    patterns = (
        rf"{word}[ _.\[#]*(({_JOINT}|(?<=[ _.])[ja])[ _.]*)?(?P<number>\d+)\]?{_UNIT}",
        rf"({_JOINT}|j|a)[ _.]*(?P<number>\d+)[ _.]*{word}{_UNIT}",
        rf"{word}{_UNIT}(?P<number>\d+)",  # columns of a matrix whose name ends in its unit
    )
    found: dict[int, tuple[str, str]] = {}
    for name in names:
        matches = (re.fullmatch(pattern, name.strip(), re.IGNORECASE) for pattern in patterns)
        match = next((one for one in matches if one), None)
        if match:
            found.setdefault(int(match["number"]), (name, match["unit"] or ""))
    first = min(found, default=2)
    numbers = range(first, first + len(found))
    if first > 1 or set(numbers) != set(found):
        return None
    columns = [found[number] for number in numbers]
    return [name for name, _ in columns], _units(signal, [unit for _, unit in columns]), first


def _by_unit(names: Sequence[str], signal: str) -> tuple[list[str], _Units, int] | None:
    """The columns of any word with numbers, all in a unit of the signal; None where there are none, or of two words."""
    words: dict[str, list[str]] = {}
    for name in names:
        match = re.fullmatch(
            rf"{_ANY}[ _.\[#]*(({_JOINT}|(?<=[ _.])[ja])[ _.]*)?\d+\]?{_UNIT}", name.strip(), re.IGNORECASE
        )
        unit = "" if match is None else (match["unit"] or "").strip(" _[]()")
        if match is not None and _SPELLED.get(unit, unit) in _TOLD_BY[signal]:
            words.setdefault(match["word"], []).append(name)
    if len(words) != 1:
        return None
    ((word, there),) = words.items()
    return _of_joints(there, signal, re.escape(word))


def _of_paired_words(names: Sequence[str], joints: Sequence[str]) -> dict[str, _Series]:
    """Signal -> its columns, where two words of any language precede the same joints, each with a unit.

    One has units of a position, the other of a current: Achse A1 [deg], Achse Z [mm], Strom A1 [A], Strom Z [A]. {}
    where no two words do, or more than two. joints: as in ``_of_named_joints``.
    """
    words: dict[tuple[str, str], dict[str, tuple[str, str]]] = {}
    for name in names:
        match = re.fullmatch(rf"(?P<word>[^\W\d_]+){_BETWEEN}(?P<joint>\w+){_UNIT}", name.strip())
        unit = "" if match is None else (match["unit"] or "").strip(" _[]()")
        signal = next((one for one in ("q", "i") if _SPELLED.get(unit, unit) in UNITS[one]), "")
        if match is not None and signal:
            words.setdefault((signal, match["word"]), {})[match["joint"]] = name, unit
    pairs = [
        (positions, currents)
        for (signal, _), positions in words.items()
        for (other, _), currents in words.items()
        if (signal, other) == ("q", "i") and positions.keys() == currents.keys()
    ]
    if len(pairs) != 1:
        return {}
    there = list(pairs[0][0])
    if all(joint.isdecimal() for joint in there):
        there.sort(key=int)
    order = list(joints) if set(joints) == set(there) else there
    return {
        signal: ([of[joint][0] for joint in order], _units(signal, [of[joint][1] for joint in order]))
        for signal, of in zip(("q", "i"), pairs[0])
    }


def _of_named_joints(names: Sequence[str], joints: Sequence[str]) -> dict[str, _Series]:
    """Signal -> its columns, where every joint of the positions has a column of the signal; {} without q and i.

    joints  names of the arm's joints: these in their order, if the columns have them all; else the order of the table
    """
    found = _by_joint(names)
    if not {"q", "i"} <= set(found):
        return {}
    there = list(found["q"])
    arm = [_bare(joint) for joint in joints]
    order = [joint for joint in arm if joint in there] if set(arm) >= set(there) else there
    if not set(order) <= set(found["i"]) or ("" in order and len(order) > 1):
        return {}
    complete = {signal: columns for signal, columns in found.items() if set(order) <= set(columns)}
    return {
        signal: ([columns[joint][0] for joint in order], _units(signal, [columns[joint][1] for joint in order]))
        for signal, columns in complete.items()
    }


def _by_joint(names: Sequence[str]) -> dict[str, dict[str, tuple[str, str]]]:
    """Signal -> joint that a column's name has beside a word for the signal -> that column, and its unit."""
    found: dict[str, dict[str, tuple[str, str]]] = {}
    taken: set[str] = set()
    for signal, word in _WORDS.items():
        for name in names:
            of = None if name in taken else _joint_of(name, word)
            if of is not None and of[0] not in found.get(signal, {}):
                found.setdefault(signal, {})[of[0]] = name, of[1]
                taken.add(name)
    return found


def _unpaired(names: Sequence[str]) -> str:
    """Of columns named by joints: which position has no current, and which current no position.

    Empty where every column has its other, or fewer do than do not: then the names mean something else.
    """
    found = _by_joint(names)
    positions, currents = found.get("q", {}), found.get("i", {})
    alone = [
        (columns[joint][0], missing)
        for columns, other, missing in ((positions, currents, "current"), (currents, positions, "position"))
        for joint in columns
        if joint and joint not in other
    ]
    if len(positions.keys() & currents.keys() - {""}) < len(alone):
        return ""
    return ", ".join(f"{name!r} has no {missing} beside it" for name, missing in alone)


def _joint_of(name: str, word: str) -> tuple[str, str] | None:
    """The joint that a column's name has beside a word for a signal ("": none), and the unit; None for other names."""
    for pattern in (
        rf"{word}{_UNIT}",
        rf"(?P<joint>.+?){_BETWEEN}{word}{_UNIT}",
        rf"{word}{_BETWEEN}(?P<joint>.+?){_UNIT}",
    ):
        if match := re.fullmatch(pattern, name.strip(), re.IGNORECASE):
            return _bare(match.groupdict().get("joint") or ""), match["unit"] or ""
    return None


def _bare(joint: str) -> str:
    """The name of a joint without the word joint at its end, which may as well begin the word for the signal."""
    return re.sub(rf"(?<=.){_BETWEEN}({_JOINT})$", "", joint, flags=re.IGNORECASE)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
