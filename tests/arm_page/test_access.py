"""Who may see and steer: roles, forged requests, foreign names, passwords, TLS; and nonsense, which is refused."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from arm_page.access import MOST_ADDRESSES, Access, Role, hosts_of
from arm_page.guard import Guarded, failed
from armscope.cli import run
from tests.arm_page.room import Room, lay_out, open_room, rig_table
from tests.daq.certificates import make_certificates

pytestmark = pytest.mark.xdist_group("page")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with open_room(tmp_path_factory.mktemp("access"), rig_table("page access")) as room:
        yield room


def test_one_server_serves_the_tests_of_a_group(request: pytest.FixtureRequest) -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        pytest.skip("one test process: nothing to group")
    # This is how pytest-xdist keeps a group in one process; where it cannot, each process starts servers of its own.
    assert request.node.nodeid.endswith("@page")


STEERING = [*(f"/api/command/{verb}" for verb in ("arm", "start", "stop", "disarm", "zero", "reset", "check"))]
STEERING += ["/api/analyses", "/api/analyses/none/stop"]


@pytest.mark.parametrize("path", STEERING)
def test_who_only_watches_cannot_steer(room: Room, path: str) -> None:
    for key in ("", "wrong", room.key[:-1]):
        status, answer = room.ask(path, {}, key=key)
        assert status == 403 and "watch" in answer["what"]
    assert room.ask(path, {})[0] != 403


def test_a_foreign_page_and_a_foreign_name_are_refused(room: Room) -> None:
    for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}, {"Host": "evil.example:80"}):
        for path, body in (("/api/command/stop", {}), ("/api/rig", None), ("/", None)):
            assert room.ask(path, body, **headers)[0] == 403, headers
    port = room.watch.rstrip("/").rpartition(":")[2]
    for own in ({"Origin": room.watch.rstrip("/")}, {"Host": f"localhost:{port}"}):
        assert room.ask("/api/rig", **own)[0] == 200


def test_a_websocket_of_a_foreign_page_is_refused(room: Room) -> None:
    port = int(room.watch.rstrip("/").rpartition(":")[2])
    for origin, expected in (("http://evil.example", 403), ("null", 403), (room.watch.rstrip("/"), 101)):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        headers = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13", "Origin": origin}
        connection.request("GET", "/api/live", headers=headers | {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="})
        assert connection.getresponse().status == expected
        connection.close()


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{", b"\xff", b"[" * 60_000, b'{"experiment": 1, "sha256": ""}', b'{"x": 1}', b"x" * 70_000]
)
def test_nonsense_is_refused_in_one_sentence(room: Room, body: bytes) -> None:
    for path in ("/api/command/arm", "/api/analyses", "/api/command/zero"):
        if body == b"" and path.endswith("zero"):
            continue  # a command without arguments
        status, answer = room.ask(path, body)
        assert status == 409 and answer["error"] == "input" and "\n" not in answer["what"]


@pytest.mark.parametrize("body", [b"[]", b"{", b"\xff", b"x" * 70_000])
def test_nonsense_at_the_login_is_refused(room: Room, body: bytes) -> None:
    status, answer = room.ask("/api/login", body, key="")
    assert status == 409 and answer["error"] == "input" and "\n" not in answer["what"]


def test_characters_of_any_kind_are_no_failure(room: Room) -> None:
    assert room.ask("/api/login", b'{"user": "lab", "password": "\\ud800"}', key="")[0] == 401
    assert room.ask("/fleets/%C3%A9/fleet.html")[0] == 404
    assert room.ask("/fleets/%00/fleet.html")[0] == 404


def test_a_failure_of_the_page_is_one_line_in_its_log(caplog: pytest.LogCaptureFixture) -> None:
    async def fails(request: Request) -> Response:
        raise ZeroDivisionError("of\nthe page")

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.request"}

    inner = Starlette(routes=[Route("/x", fails)], exception_handlers={Exception: failed})
    guarded = Guarded(inner, frozenset({"a:1"}), secure=False)
    scope = {"type": "http", "method": "GET", "path": "/x", "query_string": b"", "headers": [(b"host", b"a:1")]}
    asyncio.run(guarded(scope, receive, send))
    assert sent[0]["status"] == 500 and json.loads(sent[1]["body"])["error"] == "page"
    line = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(line) == 1 and "\n" not in line[0]
    assert line[0].startswith("GET '/x' failed: ZeroDivisionError: ") and "test_access.py" in line[0]


def test_names_of_files_lead_nowhere_else(room: Room) -> None:
    (room.folder / "secret.mcap").write_bytes(b"secret")
    for name in ("..%2Fsecret.mcap", "..%2F..%2Fetc%2Fpasswd", "%2Fetc%2Fpasswd", ".", "secret.mcap"):
        for path in ("/api/recordings/", "/api/preview/", "/reports/", "/static/"):
            assert room.ask(path + name)[0] in (404, 409)
    status, answer = room.ask("/api/analyses", {"name": "identify", "recordings": ["../secret.mcap"]})
    assert status == 409 and "no recording" in answer["what"]


def test_what_is_armed_is_what_was_previewed(room: Room) -> None:
    _, shown = room.ask("/api/preview/short.toml")
    file = room.folder / "experiments/short.toml"
    text = file.read_text()
    file.write_text(text.replace("amplitude = 0.1", "amplitude = 0.2"))
    try:
        status, answer = room.ask("/api/command/arm", {"experiment": "short.toml", "sha256": shown["sha256"]})
        assert status == 409 and "changed since it was previewed" in answer["what"]
    finally:
        file.write_text(text)


def test_check_answers_for_every_device(room: Room) -> None:
    status, answer = room.ask("/api/command/check", {})
    assert status == 200 and set(answer["devices"]) == {"counter1", "counter2", "analog", "tracker", "arm"}
    assert all(found["identity"] and not found["problems"] for found in answer["devices"].values())


def test_with_passwords_nobody_sees_anything_without_one(tmp_path: Path) -> None:
    make_certificates(tmp_path, "127.0.0.1")
    tls = {"authority": "ca.pem", "certificate": "rig.pem", "key": "rig.key"}
    table = rig_table("page passwords")
    table["page"] = {"tls": tls, "password_file": "passwords", "steer": ["lab"]}
    context = ssl.create_default_context(cafile=tmp_path / "ca.pem") if (tmp_path / "ca.pem").exists() else None
    with open_room(tmp_path, table, addresses=1) as room:
        assert room.steer.startswith("https://") and not room.key
        port = int(room.steer.rstrip("/").rpartition(":")[2])

        def ask(path: str, body: Any = None, token: str = "") -> tuple[int, Any]:
            connection = http.client.HTTPSConnection("127.0.0.1", port, context=context, timeout=30)
            headers = {"Authorization": f"Bearer {token}"} if token else {}
            connection.request("GET" if body is None else "POST", path, json.dumps(body), headers)
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())

        for path in ("/api/rig", "/api/experiments", "/api/recordings", "/api/devices"):
            assert ask(path)[0] == 401 and ask(path, token="x" * 32)[0] == 401
        assert ask("/api/command/stop", {})[0] == 401
        tokens = {}
        for user, password in (("lab", "secret"), ("guest", "guest")):
            status, answer = ask("/api/login", {"user": user, "password": password})
            assert status == 200
            tokens[user] = answer["token"]
        assert ask("/api/rig", token=tokens["lab"])[1]["role"] == "steer"
        assert ask("/api/rig", token=tokens["guest"])[1]["role"] == "watch"
        assert ask("/api/command/stop", {}, tokens["guest"])[0] == 403
        assert ask("/api/command/stop", {}, tokens["lab"])[0] == 200
        assert ask("/api/login", {"user": "lab", "password": "wrong"})[0] == 401
        # Right, but too soon after the wrong one.
        assert ask("/api/login", {"user": "lab", "password": "secret"})[0] == 401


def test_sessions_end_and_a_wrong_password_costs_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("arm_page.access.time.monotonic", lambda: now[0])
    access = Access({"lab": "secret", "guest": "x"}, ["lab"])
    token = access.log_in("lab", "secret", "a")
    assert token is not None and access.role(token) is Role.STEER and access.role("") is None
    assert access.log_in("lab", "wrong", "a") is None and access.log_in("lab", "secret", "a") is None
    assert access.log_in("lab", "secret", "b") is not None
    now[0] = 1.5
    assert access.log_in("nobody", "", "c") is None and access.log_in("lab", "secret", "a") is not None
    now[0] = 13 * 3600.0
    assert access.role(token) is None
    for _ in range(1000):
        assert access.log_in("guest", "x", "a")
    assert len(access._sessions) <= 256


def test_a_wrong_password_of_any_characters_tells_no_users(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("arm_page.access.time.monotonic", lambda: now[0])
    access = Access({"lab": "sécret"}, ["lab"])
    for user in ("lab", "nobody", "\ud800"):
        for password in ("\ud800", "é", ""):
            now[0] += 2.0
            assert access.log_in(user, password, "a") is None
    now[0] += 2.0
    assert access.log_in("lab", "sécret", "a")


def test_after_many_addresses_a_wrong_password_still_costs_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arm_page.access.time.monotonic", lambda: 0.0)
    access = Access({"lab": "secret"}, ["lab"])
    for number in range(MOST_ADDRESSES + 10):
        assert access.log_in("lab", "wrong", f"10.0.0.{number}") is None
    assert access.log_in("lab", "secret", f"10.0.0.{MOST_ADDRESSES + 9}") is None  # the newest
    assert access.log_in("lab", "secret", "10.0.0.0")  # the oldest is forgotten
    assert len(access._not_before) <= MOST_ADDRESSES


def test_names_of_a_page() -> None:
    assert hosts_of("127.0.0.1", 80) == {"127.0.0.1:80", "localhost:80", "[::1]:80"}
    assert hosts_of("192.168.7.10", 443, ["Rig.Lab"]) == {"192.168.7.10:443", "rig.lab:443"}


@pytest.mark.parametrize(
    ("page", "says"),
    [
        ({"listen": "0.0.0.0:8700"}, "requires 'tls' and 'password_file'"),
        ({"listen": "192.168.7.10:8700"}, "requires 'tls' and 'password_file'"),
        ({"listen": "8700"}, "must have a form like 127.0.0.1:8700"),
        ({"listen": "127.0.0.1:99999"}, "must have a form like 127.0.0.1:8700"),
        ({"steer": ["lab"]}, "password_file"),
        ({"tls": {"authority": "a", "certificate": "b", "key": "c"}}, "go together"),
        ({"port": 8700}, "port"),
    ],
)
def test_a_wrong_page_table_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], page: dict[str, Any], says: str
) -> None:
    path = lay_out(tmp_path, rig_table("page wrong", page=page))
    assert run(["page", str(path), "--no-browser", "--recordings", str(tmp_path / "r")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and says in error
    assert not (tmp_path / "r").exists()
