"""The memory that a camera's frames land in, while a take runs."""
import fcntl
import os
import struct
from typing import List, NamedTuple, Optional

import numpy as np

from . import lightstage_pb2 as messages
from .arrays import Array
from .errors import Error
from .shared import memory_of

HEAD = struct.Struct("<8sIIQQ")  # magic, slots, 0, stride, payload_bytes
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | 0x10  # FUTURE_WRITE, which Python does not know
ENTRIES = 64 // 8  # of the index, in words of 64 bits: change and number of each slot


class Frame(NamedTuple):
    number: int  # counted from 1 since the take began
    payload: Array  # uint8 [payload_bytes], a copy: pixels in the ring's `pixel_format`, and more


class Ring:
    """A camera's ring, read-only. `report` says what it is of: take, width, height, pixel_format, slots,
    payload_bytes. It stays until nobody holds it; once its take has ended nothing lands in it."""

    def __init__(self, report: messages.RingReply, fds: List[int]):
        self.report = report
        try:
            self._memory = memory_of(fds, report.bytes, SEALS)
        finally:
            while fds:
                os.close(fds.pop())
        if HEAD.unpack_from(self._memory, report.index_at) != (
                b"LSRING 1", report.slots, 0, report.stride, report.payload_bytes):
            raise Error("the daemon's ring of frames is not laid out as it says")
        self._index = np.frombuffer(self._memory, "<u8", ENTRIES + 2 * report.slots,
                                    report.index_at)

    def newest(self) -> Optional[Frame]:
        """The newest frame that can be read, whole; None: none can. One can from its landing until it
        is merged and its place free for another, milliseconds later: look often."""
        changes, numbers = self._index[ENTRIES::2], self._index[ENTRIES + 1::2]
        for slot in np.argsort(numbers)[::-1]:
            before, number = int(changes[slot]), int(numbers[slot])
            if before % 2 or not number:
                continue
            payload = np.frombuffer(self._memory, np.uint8, self.report.payload_bytes,
                                    int(slot) * self.report.stride).copy()
            if int(changes[slot]) == before:
                return Frame(number, payload)
        return None
