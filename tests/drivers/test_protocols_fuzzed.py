"""Every parser under arbitrary bytes, in arbitrary pieces: no crash, nothing accepted that was not sent."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import modbus_tcp as modbus
from drivers.cia406 import protocol as cia
from drivers.isabellenhuette_ivts import protocol as ivt
from drivers.labjack_t7 import protocol as t7
from drivers.linux_counter import parse_count
from drivers.tracker_stream.protocol import Lines, format_line
from drivers.us_digital_ad4b import protocol as ad4b
from drivers.us_digital_qsb import protocol as qsb
from drivers.val_terminal import protocol as val

bounded = settings(max_examples=40)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    """The bytes in pieces that end at these places."""
    places = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(places)]


cuts = st.lists(st.integers(0, 10_000), max_size=12)
PARSERS: dict[str, Callable[[], Callable[[bytes], object]]] = {
    "modbus": lambda: modbus.Frames().feed,
    "t7 stream": lambda: t7.Stream(t7.ScanList((0, 1), (0,))).feed,
    "qsb": lambda: qsb.Replies().feed,
    "val": lambda: _running_session().feed,
    "tracker": lambda: Lines().feed,
}


def _running_session() -> val.Session:
    session = val.Session()
    session.type(val.WHERE)
    session.feed(b"WHERE")
    return session


@pytest.mark.parametrize("name", PARSERS)
@given(data=st.binary(max_size=400), cuts=cuts)
@bounded
def test_no_bytes_crash_a_parser(name: str, data: bytes, cuts: list[int]) -> None:
    feed = PARSERS[name]()
    with contextlib.suppress(modbus.FrameError, t7.StreamStopped):
        for piece in pieces(data, cuts):
            feed(piece)


frames = st.builds(
    modbus.Frame,
    transaction=st.integers(0, 65535),
    unit=st.integers(0, 255),
    function=st.integers(0, 255),
    body=st.binary(max_size=250),
)


@given(sent=st.lists(frames, max_size=6), cuts=cuts)
@bounded
def test_modbus_frames_survive_any_cutting(sent: list[modbus.Frame], cuts: list[int]) -> None:
    parser = modbus.Frames()
    got = [f for piece in pieces(b"".join(map(modbus.encode, sent)), cuts) for f in parser.feed(piece)]
    assert got == sent


@given(reply=frames, registers=st.integers(1, 125))
@bounded
def test_only_a_read_reply_of_the_right_length_is_data(reply: modbus.Frame, registers: int) -> None:
    try:
        data = modbus.read_data(reply, registers)
    except modbus.FrameError:
        return
    assert reply.function == modbus.READ and len(data) == 2 * registers


SCAN = t7.ScanList((0, 1), (0, 2))


def stream_bytes(rows: np.ndarray, scans: int, status: int = 0, info: int = 0) -> bytes:
    packets = [rows[k : k + scans] for k in range(0, len(rows), scans)]
    return b"".join(
        t7.encode_packet(k, t7.Packet(0, status if k == 0 else 0, info if k == 0 else 0, p.ravel()))
        for k, p in enumerate(packets)
    )


def random_rows(scans: int, seed: int) -> np.ndarray:
    rows = np.random.default_rng(seed).integers(0, 65536, (scans, SCAN.slots)).astype(np.uint16)
    rows[:, :2] %= 65535  # an AIN never gives 0xFFFF
    return rows


@given(seed=st.integers(0, 1000), scans=st.integers(1, 40), packet=st.integers(1, 8))
@bounded
def test_t7_scans_come_out_as_sent_in_44_byte_pieces(seed: int, scans: int, packet: int) -> None:
    rows = random_rows(scans * packet, seed)
    data = stream_bytes(rows, packet)
    stream = t7.Stream(SCAN)
    got = [stream.feed(data[k : k + 44]) for k in range(0, len(data), 44)]
    number = np.concatenate([g.number for g in got])
    assert np.array_equal(number, np.arange(len(rows)))
    assert np.array_equal(np.concatenate([g.codes for g in got]), rows[:, :2])
    wide = rows[:, 2:].astype(np.int64)
    assert np.array_equal(np.concatenate([g.counts for g in got]), (wide[:, 0::2] | wide[:, 1::2] << 16)[:, :2])
    assert np.array_equal(np.concatenate([g.timer for g in got]), (wide[:, 4] | wide[:, 5] << 16))


@given(seed=st.integers(0, 1000), packet=st.integers(1, 8), at=st.integers(0, 7), skipped=st.integers(1, 65535))
@bounded
def test_auto_recovery_shifts_the_numbers_by_the_scans_skipped(seed: int, packet: int, at: int, skipped: int) -> None:
    at %= packet
    rows = random_rows(2 * packet, seed)
    rows[at] = t7.SEPARATOR
    got = t7.Stream(SCAN).feed(stream_bytes(rows, packet, t7.Status.RECOVERED, skipped))
    before = list(range(at))
    after = [at + skipped + k for k in range(2 * packet - at - 1)]
    assert got.number.tolist() == before + after
    assert got.skipped == skipped
    assert not (got.codes == t7.SEPARATOR).any()


def test_a_stream_that_the_t7_ended_says_why() -> None:
    for status in (t7.Status.OVERLAP, t7.Status.RECOVERY_OVERFLOW, t7.Status.BUFFER_FULL):
        with pytest.raises(t7.StreamStopped) as stopped:
            t7.Stream(SCAN).feed(stream_bytes(random_rows(1, 1), 1, status))
        assert stopped.value.status == status


def test_recovery_without_its_separator_is_refused() -> None:
    with pytest.raises(modbus.FrameError):
        t7.Stream(SCAN).feed(stream_bytes(random_rows(4, 1), 4, t7.Status.RECOVERED, 3))


@given(code=st.integers(0, 65534))
@bounded
def test_t7_volts_and_codes_are_inverse(code: int) -> None:
    calibration = t7.InputCalibration()
    volts = calibration.volts(np.array([code], np.uint16))
    assert calibration.codes(volts)[0] == code
    assert abs(volts[0] - (code * 0.000315805780 - 10.586956522)) < 1e-3  # U6/T7 constants: slope and offset form


@given(values=st.lists(st.integers(0, 0xFFFFFFFF), max_size=20), cuts=cuts, hole=st.integers(0, 1000))
@bounded
def test_a_qsb_reply_that_lost_a_byte_is_no_reply(values: list[int], cuts: list[int], hole: int) -> None:
    data = b"".join(b"s0E%08X!" % v for v in values)
    if data:
        hole %= len(data)
        lost = data[:hole] + data[hole + 1 :]
        parser = qsb.Replies(stamped=False)
        got = [r.value for piece in pieces(lost, cuts) for r in parser.feed(piece)]
        k = hole // 12
        end = data[hole : hole + 1] == b"!"  # without its end, a reply spoils the next one, too
        assert got == values[:k] + values[k + 1 + end :]
    parser = qsb.Replies(stamped=False)
    assert [r.value for piece in pieces(data, cuts) for r in parser.feed(piece)] == values


@given(answer=st.binary(max_size=8))
@bounded
def test_an_ad4b_position_is_four_bytes(answer: bytes) -> None:
    value = ad4b.position(answer)
    assert (value is not None) == (len(answer) == 4)
    assert value is None or 0 <= value < 1 << 24


def test_ad4b_checksum_takes_sum_and_xor_and_nothing_longer() -> None:
    command = ad4b.initialise_command("x4")
    assert ad4b.confirms_initialise(command, bytes([sum(command) & 0xFF]))
    assert not ad4b.confirms_initialise(command, b"")
    assert not ad4b.confirms_initialise(command, bytes([0x77]))


@given(data=st.binary(max_size=8))
@bounded
def test_frames_on_the_can_bus_are_taken_only_in_their_form(data: bytes) -> None:
    value = cia.position(data)
    assert (value is not None) == (len(data) == 4)
    result = RESULTS.take(data)
    assert (result is not None) == (len(data) == 6 and data[0] == 0)
    if result is not None:  # the .dbc against a second reading of the data sheet
        assert result.value == pytest.approx(struct.unpack(">i", data[2:])[0] / 1000)
        assert result.faulty == bool(data[1] & 0xE0)


RESULTS = ivt.Results()


@given(lost=st.lists(st.integers(0, 15), min_size=1, max_size=20))
@bounded
def test_the_ivts_counter_finds_lost_frames(lost: list[int]) -> None:
    RESULTS.restart()
    before, counter, found = RESULTS.lost, 0, []
    for hole in lost:
        counter = (counter + 1 + hole) % 16
        result = RESULTS.take(bytes([0, counter, 0, 0, 0, 7]))
        assert result is not None
        found.append(result.lost)
    assert found[1:] == lost[1:]
    assert RESULTS.lost - before == sum(lost[1:])


@given(frame=st.integers(1, 10**9), seconds=st.floats(0, 1e5), point=st.tuples(*[st.floats(-1e4, 1e4)] * 3), cuts=cuts)
@bounded
def test_tracker_lines_come_back(frame: int, seconds: float, point: tuple[float, ...], cuts: list[int]) -> None:
    lines = Lines()
    line = format_line(frame, seconds, np.array(point))
    got = [f for piece in pieces(line, cuts) for f in [lines.feed(piece)] if len(f)]
    assert len(got) == 1 and lines.refused == 0
    assert got[0].number[0] == frame
    assert got[0].seconds[0] == pytest.approx(seconds, abs=1e-6)
    assert got[0].points[0] == pytest.approx(np.array(point), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(
    "line",
    [
        b"0,1,1,2,3",
        b"1,-1,1,2,3",
        b"1,1,1,2",
        b"1,1,1,2,3,4",
        b"1,1,inf,2,3",
        b"1,1,,2,3",
        b"x,1,1,2,3",
        b"1,nan,1,2,3",
    ],
)
def test_lines_that_are_no_points_are_refused(line: bytes) -> None:
    lines = Lines()
    assert len(lines.feed(line + b"\n")) == 0 and lines.refused == 1


def test_a_broken_beam_is_a_point_without_a_place() -> None:
    frames = Lines().feed(b"7,0.5,,,\n8,0.6,nan,NaN,nan\n")
    assert frames.number.tolist() == [7, 8] and np.isnan(frames.points).all()


@given(text=st.binary(max_size=12))
@bounded
def test_a_sysfs_count_is_digits_and_a_newline(text: bytes) -> None:
    try:
        value = parse_count(text)
    except ValueError:
        return
    assert text.strip().decode().isdecimal() and value == int(text)


@given(noise=st.binary(min_size=1, max_size=3), place=st.integers(0, 4))
@bounded
def test_a_command_is_entered_only_when_its_echo_was_right(noise: bytes, place: int) -> None:
    session = val.Session()
    typed = session.type("WHERE")
    echo = typed[:place] + noise + typed[place:]
    sent, _ = session.feed(echo)
    assert (sent == val.ENTER) == (echo.decode("ascii", "replace").rsplit("\n", 1)[-1].lstrip(".\r ") == "WHERE")


@given(degrees=st.lists(st.floats(-300, 300), min_size=6, max_size=6))
@bounded
def test_where_is_read_as_printed(degrees: list[float]) -> None:
    hand = "  ".join(f"{d / 3:9.2f}" for d in degrees)
    joints = "  ".join(f"{d:9.3f}" for d in degrees)
    got = val.where(("X/JT1  Y/JT2  Z/JT3  O/JT4  A/JT5  T/JT6", hand, joints))
    assert got == pytest.approx(degrees, abs=6e-4)
    assert val.where(("no heading", hand, joints)) is None


@given(lines=st.lists(st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=20)), cuts=cuts)
@bounded
def test_an_answer_ends_at_the_prompt_however_it_is_cut(lines: list[str], cuts: list[int]) -> None:
    lines = [line.strip() for line in lines if line.strip() and not line.strip().startswith(val.PROMPT)]
    session = val.Session()
    session.type("WHERE")
    assert session.feed(b"WHERE")[0] == val.ENTER
    answer = ("\r\n" + "".join(line + "\r\n" for line in lines) + ".").encode()
    done = [d for part in pieces(answer, cuts) for d in session.feed(part)[1]]
    assert [d.lines for d in done] == [tuple(lines)] and session.state == val.State.IDLE
