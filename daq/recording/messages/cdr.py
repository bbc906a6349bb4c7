"""Fixed-size CDR messages: constant bytes with holes for numbers, so that numpy fills a thousand of them in one pass.

Plain CDR, little endian (OMG DDSI-RTPS 2.3, 10.5): a 4-byte encapsulation header, then every primitive aligned to its
own size, counted from behind that header. A string is its length with the closing NUL (uint32), its bytes, the NUL; a
sequence is its length (uint32), then its elements, whose alignment applies only where there are any.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ENCAPSULATION = b"\x00\x01\x00\x00"
"""CDR_LE, no options."""


class Message:
    """The bytes of one message as it is put together, field by field in the order of its definition.

    template  the message with every number 0
    fields    name -> (numpy format, offset in the template)
    """

    def __init__(self) -> None:
        self.template = bytearray(ENCAPSULATION)
        self.fields: dict[str, tuple[str | tuple[str, tuple[int, ...]], int]] = {}

    def number(self, name: str, form: str) -> Message:
        """A number to be filled in; ``form`` is a numpy format such as '<f8'."""
        self._align(np.dtype(form).itemsize)
        self.fields[name] = (form, len(self.template))
        self.template += bytes(np.dtype(form).itemsize)
        return self

    def stamp(self, name: str) -> Message:
        """builtin_interfaces/Time (int32 sec, uint32 nanosec) as one 64-bit number: see ``stamps``."""
        self._align(4)
        self.fields[name] = ("<u8", len(self.template))
        self.template += bytes(8)
        return self

    def string(self, text: str) -> Message:
        """A constant string."""
        data = text.encode() + b"\0"
        self._length(len(data))
        self.template += data
        return self

    def strings(self, texts: Sequence[str]) -> Message:
        """A constant sequence of strings."""
        self._length(len(texts))
        for text in texts:
            self.string(text)
        return self

    def sequence(self, name: str, form: str, length: int) -> Message:
        """A sequence of ``length`` numbers to be filled in; an empty one leaves no field."""
        self._length(length)
        if length:
            self._align(np.dtype(form).itemsize)
            self.fields[name] = ((form, (length,)), len(self.template))
            self.template += bytes(np.dtype(form).itemsize * length)
        return self

    def length(self, count: int) -> Message:
        """The length of a sequence of messages, which follow one by one."""
        self._length(count)
        return self

    def _length(self, length: int) -> None:
        self._align(4)
        self.template += length.to_bytes(4, "little")

    def _align(self, size: int) -> None:
        self.template += bytes(-(len(self.template) - len(ENCAPSULATION)) % size)


def stamps(wall_ns: np.ndarray) -> np.ndarray:
    """(n,) uint64: times (n,) int64 ns as builtin_interfaces/Time.

    Seconds are in the low half, nanoseconds in the high half.
    """
    seconds, nanoseconds = np.divmod(wall_ns, 1_000_000_000)
    return seconds.astype(np.uint64) & np.uint64(0xFFFFFFFF) | nanoseconds.astype(np.uint64) << np.uint64(32)


def fillable(message: Message) -> tuple[bytearray, np.ndarray]:
    """The bytes of one message, and a view (1,) of the numbers in them by field name."""
    data, names = bytearray(message.template), list(message.fields)
    forms = [message.fields[name][0] for name in names]
    offsets = [message.fields[name][1] for name in names]
    layout: np.dtype = np.dtype({"names": names, "formats": forms, "offsets": offsets, "itemsize": len(data)})
    return data, np.frombuffer(data, layout, 1)
