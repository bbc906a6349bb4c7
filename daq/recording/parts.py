"""The parts of a recording's file, in the order in which they are written: head, attachments, chunks, ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from mcap.records import Metadata, Schema
from numpy.typing import NDArray

from arm_clearance import Chain
from arm_io import DeviceFault
from daq.acquisition.ledger import SENTENCES, LedgerSummary, Loss
from daq.recording.mcap_file import writer as mcap_writer
from daq.recording.mcap_file.writer import McapFile
from daq.recording.messages import ros2_messages
from daq.recording.messages.rates import rates
from daq.recording.messages.row_format import POSE_COLUMNS, Layout, RowFormat
from daq.recording.messages.viewers import UNKNOWN_POSE, held, places_in, viewer_channels, viewer_schemas


@dataclass(frozen=True)
class Attachments:
    """What a recording carries so that everything in it can be recomputed.

    Texts are stored unchanged; None: there is none.

    rig, model, experiment  TOML texts
    calibration             as ``daq.rig.calibration`` puts it (with its content hash)
    provenance              who, where, when, with which versions; strings, numbers, lists, tables
    chain                   the arm of the model, for viewers: becomes /tf and /robot_description
    """

    rig: str | None = None
    model: str | None = None
    experiment: str | None = None
    calibration: dict | None = None
    provenance: dict = field(default_factory=dict)
    chain: Chain | None = None

    def files(self) -> dict[str, tuple[str, bytes]]:
        """File name -> (media type, content)."""
        files = {}
        for name in ("rig", "model", "experiment"):
            text = getattr(self, name)
            if text is not None:
                files[f"{name}.toml"] = ("application/toml", text.encode())
        if self.calibration is not None:
            files["calibration.json"] = ("application/json", mcap_writer.as_json(self.calibration))
        files["provenance.json"] = ("application/json", mcap_writer.as_json(self.provenance))
        return files


Files = Mapping[str, tuple[str, bytes]]
"""File name -> (media type, content)."""


def open_file(
    path: str | Path,
    form: RowFormat,
    files: Files,
    *,
    live: bool = False,
    replace: bool = False,
    viewers: bool = False,
) -> McapFile:
    """A file with its head and attachments.

    InputError where it cannot be made, DeviceFault where the disk fails; nothing is left then.

    live     as ``mcap_writer.create`` has it
    viewers  whether chunks for viewers will be written
    """
    file = mcap_writer.create(path, live=live, replace=replace)
    schemas = [
        Schema(number, ros2_messages.DEFINITIONS[name].encode(), "ros2msg", name)
        for number, name in enumerate(form.types, 1)
    ]
    channels = form.channels()
    if viewers:
        schemas += viewer_schemas(form)
        channels += viewer_channels(form)
    try:
        file.begin(f"armscope {_version()}", schemas, channels)
        for name, (media_type, data) in files.items():
            file.attach(name, media_type, data)
    except OSError as error:
        file.abandon()
        raise DeviceFault("disk", f"{error.strerror} while beginning {path}") from None
    return file


def write_chunk(file: McapFile, form: RowFormat, columns: dict[str, NDArray]) -> None:
    """One chunk of rows; ``columns`` as ``RowFormat.pack`` takes them, and 'wall_ns'."""
    write_content(file, form, form.pack(columns, columns["wall_ns"]), columns["wall_ns"])


def write_content(file: McapFile, form: RowFormat, content: bytes | bytearray, wall_ns: NDArray[np.int64]) -> None:
    """One chunk whose content is packed already."""
    offsets = {topic.channel: form.message_offsets(topic, len(wall_ns)) for topic in form.topics}
    file.chunk(content, wall_ns, offsets)


def write_pictures(file: McapFile, content: bytes) -> None:
    """One chunk for viewers, as ``Viewers.contents`` makes them."""
    channel, wall_ns, starts = places_in(content)
    file.chunk(content, wall_ns, {channel: starts})


def finish_file(file: McapFile, ledger: LedgerSummary) -> None:
    """The ledger, for us as an attachment and for everybody as metadata, then the summary."""
    table = ledger_table(ledger)
    file.attach("ledger.json", "application/json", mcap_writer.as_json(table))
    values = {key: str(table[key]) for key in ("triggers", "latched", "recorded", "lost", "balanced")}
    file.metadata(Metadata("armscope:ledger", values))
    file.finish()


def loss_tables(losses: Sequence[Loss]) -> list[dict]:
    """Losses as JSON has them."""
    return [
        {"first": loss.first, "rows": loss.rows, "reason": str(loss.reason), "detail": loss.detail}
        | {"sentence": SENTENCES[loss.reason]}
        for loss in losses
    ]


def ledger_table(ledger: LedgerSummary) -> dict:
    """The ledger as JSON has it."""
    return {
        "triggers": ledger.triggers,
        "latched": ledger.latched,
        "recorded": ledger.recorded,
        "lost": ledger.lost,
        "balanced": ledger.balanced,
        "losses": loss_tables(ledger.losses),
    }


class Derivatives:
    """What viewers need in addition to the measured columns.

    Of the joints velocity (``rates``, with the two rows before a piece, without those behind it) and effort (torque);
    of a floating base its newest known pose.
    """

    def __init__(self, layout: Layout) -> None:
        self._effort = np.array(layout.effort)
        self._pose = [layout.extra.index(name) for name in POSE_COLUMNS] if layout.pose else []
        self._newest_pose = UNKNOWN_POSE
        self._q = np.empty((0, len(layout.signals["q"])))
        self._wall_ns = np.empty(0, np.int64)

    def __call__(self, piece: dict[str, NDArray]) -> dict[str, NDArray]:
        q, wall_ns = np.concatenate([self._q, piece["q"]]), np.concatenate([self._wall_ns, piece["wall_ns"]])
        derived = {"velocity": rates(q, wall_ns)[len(self._q) :]}
        if len(self._effort) and "i" in piece:
            derived["torque"] = piece["i"] * self._effort
        if self._pose:
            derived["base_pose"] = held(piece["extra"][:, self._pose], self._newest_pose)
            self._newest_pose = derived["base_pose"][-1]
        self._q, self._wall_ns = q[-2:], wall_ns[-2:]
        return derived


def _version() -> str:
    try:
        return version("armscope")
    except PackageNotFoundError:
        return "(not installed)"
