"""Plans are checked when they are read, and find their recordings by arm and night."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_archive import open_archive
from arm_fleet import arm_nights, read_plan
from arm_fleet.recordings import identity
from arm_fleet.storage import file_system
from arm_io import InputError
from daq.recording import Attachments, write_table

PLAN = """
model = "model.toml"
recordings = "{arm}/PATTERN"
[[arm]]
name = "a1"
[[arm]]
name = "a2"
"""


def recording(path: Path, noise: int = 0, made: str = "2026-01-01T23:00:00Z", begin: float = 0.0) -> Path:
    """begin: s since 1970 of the first row; 0: the rows do not say."""
    path.parent.mkdir(parents=True, exist_ok=True)
    t = begin + np.arange(200) / 100
    q = np.random.default_rng(noise).normal(size=(200, 2))
    write_table(path, t, {"q": q, "i": q}, Attachments(provenance={"made": made}))
    return path


def plan(folder: Path, text: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ("[[arm]]\nname = 'a1'", "arm 'a1' is named twice"),
        ("[[arm]]\nname = 'a/b'", "arm[3].name"),
        ("[[arm]]\nname = 'a3'\nmodle = 'x'", "arm[3].modle: unknown entry"),
    ],
)
def test_a_wrong_plan_is_refused(tmp_path: Path, more: str, complaint: str) -> None:
    with pytest.raises(InputError, match=r"plan\.toml: ") as caught:
        read_plan(plan(tmp_path, PLAN + more))
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    ("head", "complaint"),
    [
        ('run = ["identify", "identify"]', "run: must name"),
        ('baseline = ["2026-02-01", "2026-01-01"]', "the first night must not be after the last"),
        ("memory = 0.01", "memory"),
        ("timeout = nan", "timeout"),
        ('folder = "x"', "folder: unknown entry"),
        ('baseline = ["2026-01-41", "2026-02-01"]', "baseline[1]: must be a date such as 2026-01-31"),
        ('limits = {"joint1.coulomb" = "much"}', "limits.joint1.coulomb: must be a number, or '+50%'"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, head: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        read_plan(plan(tmp_path, f"{head}\n{PLAN}"))
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    ("pattern", "complaint"),
    [
        ("", "recordings: must be a pattern such as"),
        ("{arm}/{nihgt}.mcap", "{nihgt} is no placeholder; must be {arm} or {night}"),
        ("{night}/*.mcap", "recordings: must contain {arm}, or arms 'a1' and 'a2' have the same recordings"),
    ],
)
def test_a_pattern_that_cannot_be_meant_is_refused(tmp_path: Path, pattern: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", pattern)))
    assert complaint in str(caught.value)


def test_nights_of_a_pattern(tmp_path: Path) -> None:
    for arm, night, run in (("a1", "2026-01-01", 1), ("a1", "2026-01-01", 2), ("a1", "2026-01-03", 1)):
        recording(tmp_path / f"data/{night}/{arm}_{run}.mcap", noise=run)
    recording(tmp_path / "data/2026-01-01/a2_1.mcap", noise=7)
    recording(tmp_path / "data/not-a-night/a2_1.mcap")
    found = arm_nights(read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "data/{night}/{arm}_*.mcap"))))
    assert [(one.arm.name, one.night, [Path(place).name for place in one.places]) for one in found] == [
        ("a1", "2026-01-01", ["a1_1.mcap", "a1_2.mcap"]),
        ("a1", "2026-01-03", ["a1_1.mcap"]),
        ("a2", "2026-01-01", ["a2_1.mcap"]),
    ]
    assert len({content for one in found for content in one.contents}) == 4


def test_an_arm_without_recordings(tmp_path: Path) -> None:
    recording(tmp_path / "a1.mcap")
    with pytest.raises(InputError, match=r"does not say when it was made; put \{night\} into the pattern"):
        arm_nights(read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "{arm}.mcap"))))
    with pytest.raises(InputError, match="has no recording of arm 'a1'"):
        arm_nights(read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "none/{night}/{arm}.mcap"))))


def test_what_one_arm_lacks_does_not_stop_the_others(tmp_path: Path) -> None:
    """No recording, one that does not say when it was made, a folder, the recording of another arm: a sentence each."""
    evening = datetime(2026, 1, 1, 23, tzinfo=UTC).timestamp()
    mine = recording(tmp_path / "a1/a1_1.mcap", begin=evening)
    cut = tmp_path / "a1/a1_2.mcap"
    cut.write_bytes(mine.read_bytes()[:-100])
    (tmp_path / "a1/a1_3.mcap").mkdir()
    read = read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "{arm}/*.mcap")))
    notes: list[str] = []
    found = arm_nights(read, notes.append)
    assert [(one.arm.name, [Path(place).name for place in one.places]) for one in found] == [("a1", ["a1_1.mcap"])]
    assert len(notes) == 2
    assert notes[0].startswith(f"{cut} is left out: it does not say when it was made")
    assert notes[1].endswith("has no recording of arm 'a2'")
    copied = tmp_path / "a2/x.mcap"
    copied.parent.mkdir()
    copied.write_bytes(mine.read_bytes())
    notes.clear()
    assert len(arm_nights(read, notes.append)) == 2
    assert f"{copied} (a2, 2026-01-01) has the content of {mine} (a1, 2026-01-01)" in notes[1]


def test_a_folder_is_no_pattern(tmp_path: Path) -> None:
    (tmp_path / "a1").mkdir()
    with pytest.raises(InputError, match=r"\{arm\}: is a folder; a pattern such as"):
        arm_nights(read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "{arm}"))))


def test_a_recording_that_cannot_be_read_is_a_task_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other nights are computed."""
    for night in ("2026-01-01", "2026-01-02"):
        recording(tmp_path / f"a1/{night}.mcap")
    local = pytest.importorskip("fsspec.implementations.local").LocalFileSystem
    whole = local.cat_file

    def refused(self: Any, path: str, *more: int, **named: int) -> bytes:
        if "2026-01-02" in path:
            raise PermissionError(13, "Permission denied")
        return bytes(whole(self, path, *more, **named))

    monkeypatch.setattr(local, "cat_file", refused)
    found = arm_nights(read_plan(plan(tmp_path, PLAN.replace("{arm}/PATTERN", "{arm}/{night}.mcap"))))
    assert [one.night for one in found] == ["2026-01-01", "2026-01-02"]
    assert found[1].contents == (f"unreadable {tmp_path / 'a1/2026-01-02.mcap'}",)


def test_nights_of_an_archive(tmp_path: Path) -> None:
    """Arms by the name of the model; a recording made after midnight belongs to the night before."""
    arms = {"a1": "2026-01-02T01:00:00Z", "a2": "2026-01-02T13:00:00Z"}
    for name, made in arms.items():
        t = np.arange(200) / 100
        q = np.random.default_rng(len(made)).normal(size=(200, 2))
        attached = Attachments(model=f'name = "{name}"\n', provenance={"made": made})
        (tmp_path / "lab").mkdir(exist_ok=True)
        write_table(tmp_path / f"lab/{name}.mcap", t, {"q": q, "i": q}, attached)
    open_archive(tmp_path / "lab").close()
    text = PLAN.replace('recordings = "{arm}/PATTERN"', 'archive = "lab"')
    found = arm_nights(read_plan(plan(tmp_path, text)))
    assert [(one.arm.name, one.night) for one in found] == [("a1", "2026-01-01"), ("a2", "2026-01-02")]


def test_the_identity_follows_the_content(tmp_path: Path) -> None:
    """Not the name; one bit of one row changes it, and so it does of a file that is cut off."""
    one, same = recording(tmp_path / "1.mcap"), tmp_path / "2.mcap"
    same.write_bytes(one.read_bytes())
    t = np.arange(200) / 100
    q = np.random.default_rng(0).normal(size=(200, 2))
    q[100, 0] = np.nextafter(q[100, 0], 1.0)
    write_table(tmp_path / "3.mcap", t, {"q": q, "i": q}, Attachments(provenance={"made": "2026-01-01T23:00:00Z"}))
    (tmp_path / "4.mcap").write_bytes(one.read_bytes()[:-20])
    (tmp_path / "5.mcap").write_bytes(one.read_bytes()[:-21])
    (tmp_path / "6.mcap").write_bytes(b"")
    found = [identity(*file_system(str(tmp_path / f"{k}.mcap"), {}))[0] for k in range(1, 7)]
    assert found[0] == found[1] and len(set(found)) == 5


def test_a_recording_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        identity(*file_system(str(tmp_path / "none.mcap"), {}))
