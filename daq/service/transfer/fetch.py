"""Brings a recording from a daemon's folder: piece by piece, its checksum verified, whole or not at all.

The pieces go to ``OUT.CHECKSUM.part`` beside the file. An interrupted transfer continues where it ended: the name
says which state of which recording it is.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError, check_file
from arm_io.handles import NO_LINK, PLAIN, read_at
from daq.service.client import call, call_for_bytes
from daq.service.transfer.folder import MOST_PIECE
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

CHECKSUM_SECONDS = 600.0
"""How long the daemon may take to read the whole file once."""
PIECE_SECONDS = 10.0
"""s, maximum time for one piece of a file."""
TRIES = 3
"""Times that a piece is asked for before the transfer fails."""
Shown = Callable[[int, int], object]


def fetch(
    session: zenoh.Session, keys: Keys, name: str, out: Path, show: Shown = lambda done, size: None
) -> dict[str, Any]:
    """Brings the recording ``name`` to ``out``; ``show`` receives the bytes received, and the total.

    Returns file, bytes, sha256 and how many bytes were here from an earlier attempt. InputError: no such recording, or
    ``out`` exists or cannot be written. DeviceFault: the daemon or the disk failed; what has come stays for the next
    attempt.
    """
    check_file(out)
    if out.exists():
        raise InputError(out, "exists already, and no recording is overwritten; give another name")
    answer = call(session, keys, "checksum", {"name": name}, timeout=CHECKSUM_SECONDS)
    size, sha256 = int(answer["bytes"]), str(answer["sha256"])
    part = out.with_name(f"{out.name}.{sha256[:12]}.part")
    try:
        handle = os.open(part, os.O_RDWR | os.O_CREAT | os.O_APPEND | PLAIN | NO_LINK, 0o644)
    except OSError as error:
        raise InputError(out, f"cannot be written: {error.strerror}") from None
    try:
        here = _transfer(session, keys, name, handle, size, show)
        _verify(handle, size, sha256, part)
        os.fsync(handle)
        os.link(part, out)  # unlike a rename it does not replace a file that has come meanwhile
        os.unlink(part)
    except FileExistsError:
        raise InputError(out, f"was made meanwhile; the fetched part is in {part}") from None
    except OSError as error:
        raise DeviceFault("disk", f"{error.strerror} while writing {part}") from None
    except DeviceFault as fault:
        raise DeviceFault(fault.device, f"{fault.what}; {_kept(part)}") from None
    finally:
        os.close(handle)
    return {"file": str(out), "name": name, "bytes": size, "sha256": sha256, "resumed": here}


def _transfer(session: zenoh.Session, keys: Keys, name: str, handle: int, size: int, show: Shown) -> int:
    """Appends what is missing; returns the bytes that were there."""
    here = done = os.fstat(handle).st_size
    while done < size:
        piece = _piece(session, keys, {"name": name, "offset": done, "length": min(MOST_PIECE, size - done)})
        if not piece:
            raise DeviceFault("daemon", f"{name} has become shorter while it was fetched")
        os.write(handle, piece)
        done += len(piece)
        show(done, size)
    return here


def _piece(session: zenoh.Session, keys: Keys, wanted: dict[str, Any]) -> bytes:
    for _ in range(TRIES - 1):
        try:
            return call_for_bytes(session, keys, "read", wanted, timeout=PIECE_SECONDS)
        except DeviceFault as fault:
            if fault.device != "daemon":
                raise
    return call_for_bytes(session, keys, "read", wanted, timeout=PIECE_SECONDS)


def _verify(handle: int, size: int, sha256: str, part: Path) -> None:
    digest = hashlib.sha256()
    offset = 0
    while block := read_at(handle, 1 << 20, offset):
        digest.update(block)
        offset += len(block)
    if offset != size or digest.hexdigest() != sha256:
        part.unlink()
        raise DeviceFault("daemon", "the received data has another checksum than the recording; fetch it again")


def _kept(part: Path) -> str:
    if not part.exists():
        return "nothing was kept"
    return f"{part.stat().st_size} bytes are in {part}: run the same command again to continue from there"
