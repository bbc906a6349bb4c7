"""Recordings on S3, served by moto: planning reads the ends of files only, tasks fetch what they compute from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_fleet import arm_nights, fetched, read_plan
from arm_fleet.recordings import identity
from arm_fleet.storage import StorageError, file_system
from arm_io import InputError
from daq.recording import open_recording
from tests.fleet.test_fetching import long_recording
from tests.fleet.test_plan import PLAN, plan, recording

pytestmark = pytest.mark.slow
NIGHTS = ("2026-01-01", "2026-01-02")


class Counting:
    """A file system that counts the bytes that it hands over."""

    def __init__(self, system: Any) -> None:
        self.system, self.read = system, 0

    def cat_file(self, *place: Any, **span: Any) -> bytes:
        data: bytes = self.system.cat_file(*place, **span)
        self.read += len(data)
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self.system, name)


@pytest.fixture
def storage(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Options of a file system with the bucket ``lab``."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    fsspec = pytest.importorskip("fsspec")
    pytest.importorskip("s3fs")
    for name, value in (("ACCESS_KEY_ID", "test"), ("SECRET_ACCESS_KEY", "test"), ("DEFAULT_REGION", "us-east-1")):
        monkeypatch.setenv(f"AWS_{name}", value)
    server.start()
    host, port = server.get_host_and_port()
    options = {"endpoint_url": f"http://{host}:{port}"}
    # Another port, and with it another file system, in each test; moto's buckets last as long as its process.
    fsspec.filesystem("s3", **options).mkdir(f"lab-{port}")
    yield options
    server.stop()


def bucket(storage: dict[str, Any]) -> str:
    return f"lab-{storage['endpoint_url'].rpartition(':')[2]}"


def test_a_plan_over_a_bucket(storage: dict[str, Any], tmp_path: Path) -> None:
    lab = bucket(storage)
    system, _ = file_system(f"s3://{lab}", storage)
    local = {}
    for arm in ("a1", "a2"):
        for k, night in enumerate(NIGHTS):
            local[arm, night] = recording(tmp_path / f"{night}/{arm}.mcap", noise=k)
            system.put_file(str(local[arm, night]), f"{lab}/{night}/{arm}.mcap")
    text = PLAN.replace("{arm}/PATTERN", f"s3://{lab}/{{night}}/{{arm}}.mcap")
    options = f"[storage]\nendpoint_url = {storage['endpoint_url']!r}\n"
    found = arm_nights(read_plan(plan(tmp_path, text + options)))
    assert [(one.arm.name, one.night) for one in found] == [(arm, night) for arm in ("a1", "a2") for night in NIGHTS]
    for one in found:
        original = local[one.arm.name, one.night]
        # The identity is that of the content, wherever it is.
        assert one.contents == (identity(*file_system(str(original), {}))[0],)
        ((copy,),) = fetched(one.places, tmp_path / "fetched" / one.arm.name / one.night, storage, 180.0).groups
        assert copy.read_bytes() == original.read_bytes()


def test_the_identity_needs_the_end_of_a_file_only(storage: dict[str, Any], tmp_path: Path) -> None:
    file = recording(tmp_path / "a.mcap")
    lab = bucket(storage)
    system, _ = file_system(f"s3://{lab}", storage)
    system.put_file(str(file), f"{lab}/a.mcap")
    counting = Counting(system)
    assert identity(counting, f"{lab}/a.mcap") == identity(*file_system(str(file), {}))
    assert 0 < counting.read < file.stat().st_size / 2


def test_of_a_long_recording_ranges_are_read(storage: dict[str, Any], tmp_path: Path) -> None:
    """The same rows as on the disk, and a fraction of the bytes."""
    file = long_recording(tmp_path / "a.mcap")
    lab = bucket(storage)
    system, _ = file_system(f"s3://{lab}", storage)
    system.put_file(str(file), f"{lab}/a.mcap")
    far = fetched([f"s3://{lab}/a.mcap"], tmp_path / "far", storage, 60.0)
    near = fetched([str(file)], tmp_path / "near", {}, 60.0)
    assert far.size == near.size == file.stat().st_size
    assert far.read == near.read < 0.3 * far.size
    for one, other in zip(far.groups[0], near.groups[0], strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(open_recording(one).q, open_recording(other).q)


def test_what_is_not_there(storage: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.mcap: cannot be read"):
        fetched([f"s3://{bucket(storage)}/none.mcap"], tmp_path, storage, 180.0)
    with pytest.raises(InputError, match=r"ftp2://x/a\.mcap: cannot be read"):
        fetched(["ftp2://x/a.mcap"], tmp_path, storage, 180.0)


def test_a_store_that_does_not_answer(storage: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line instead of the client's own errors: nobody at the address, no key, an option that there is none."""
    lab = bucket(storage)
    nobody = storage["endpoint_url"].rpartition(":")[0] + ":9"
    text = PLAN.replace("{arm}/PATTERN", f"s3://{lab}/{{night}}/{{arm}}.mcap")
    for options, what in (
        (f"endpoint_url = {nobody!r}", "Could not connect"),
        (
            f"endpoint = {storage['endpoint_url']!r}",
            "unexpected keyword argument 'endpoint'; see .storage. of the plan",
        ),
    ):
        with pytest.raises(InputError, match=rf"^s3://.*mcap: cannot be read: .*{what}"):
            arm_nights(read_plan(plan(tmp_path, f"{text}[storage]\n{options}\n")))
    with pytest.raises(StorageError, match="cannot be read: Could not connect"):
        fetched([f"s3://{lab}/a.mcap"], tmp_path, {"endpoint_url": nobody}, 180.0)
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    system_options = f"endpoint_url = {storage['endpoint_url']!r}\nuse_listings_cache = false"
    with pytest.raises(InputError, match=r"^s3://.*mcap: cannot be read: Unable to locate credentials"):
        arm_nights(read_plan(plan(tmp_path, f"{text}[storage]\n{system_options}\n")))
