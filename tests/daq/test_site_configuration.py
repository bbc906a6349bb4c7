"""The configurations of docs/sites.md are files that Zenoh reads, as ``zenohd --config`` does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import zenoh

from tests.daq.test_sites import documented


@pytest.mark.parametrize(("heading", "mode"), [("The router", "router"), ("A watcher", "client")])
def test_zenoh_reads_what_the_document_says(root: Path, tmp_path: Path, heading: str, mode: str) -> None:
    """Every entry is one that Zenoh knows: an unknown one is refused (below)."""
    table = documented(root, heading)
    path = tmp_path / "zenoh.json"
    path.write_text(json.dumps(table))
    config = zenoh.Config.from_file(str(path))
    assert json.loads(config.get_json("mode")) == mode == table["mode"]
    assert json.loads(config.get_json("connect/endpoints")) == table["connect"]["endpoints"]
    if mode == "router":
        read = json.loads(config.get_json("access_control"))
        assert (read["enabled"], read["default_permission"]) == (True, "allow")
        assert [rule["key_exprs"] for rule in read["rules"]] == [
            rule["key_exprs"] for rule in table["access_control"]["rules"]
        ]


def test_zenoh_refuses_a_misspelt_entry(root: Path, tmp_path: Path) -> None:
    table = documented(root, "The router")
    table["access_control"]["default_permision"] = table["access_control"].pop("default_permission")
    path = tmp_path / "zenoh.json"
    path.write_text(json.dumps(table))
    with pytest.raises(zenoh.ZError):
        zenoh.Config.from_file(str(path))
