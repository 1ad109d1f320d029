"""One connection's bytes: frames out, frames in, each payload where it is to lie.

An exception may come at any moment (Ctrl-C, an alarm), also in the middle of a frame; what was
received and sent until then must be known all the same, or nothing after it can be understood. So a
count is recorded by the very call that receives: list.extend(map(...)) is one step of the
interpreter, between whose parts no signal handler runs. Python's ssl module runs them after it has
read, and forgets how much: a thread does it, where signal handlers never run.
"""
import collections
import queue
import select
import socket
import ssl
import struct
import threading
from typing import Any, Callable, Deque, Iterator, List, NamedTuple, Optional, Tuple

from .errors import Lost

HEADER = struct.Struct("<4sHHIIIIQ")
MAGIC, VERSION, FLAG_LAST, MAX_MESSAGE_BYTES = b"LSTG", 1, 1, 65536
ANCILLARY_BYTES = socket.CMSG_SPACE(struct.calcsize("i"))


class Head(NamedTuple):
    kind: int
    last: bool
    request: int
    message_bytes: int
    payload_bytes: int
    fds: List[int]  # that came with it; the receiver's to close


class Frame(NamedTuple):
    head: Head
    message: bytes
    place: Any  # what the callback of its payload said beside the buffers


# Where a payload goes: buffers of its length in all, and a word for whoever gets the frame.
Place = Callable[[Head, bytes], Tuple[List[memoryview], Any]]


def parse(header: bytes, fds: List[int]) -> Head:
    magic, version, kind, flags, request, n_message, reserved, n_payload = HEADER.unpack(header)
    if magic != MAGIC or version != VERSION or flags & ~FLAG_LAST or reserved \
            or n_message > MAX_MESSAGE_BYTES:
        raise Lost("what answers does not speak this protocol, or the stream is damaged: "
                   f"header {header.hex()}")
    return Head(kind, bool(flags & FLAG_LAST), request, n_message, n_payload, fds)


class Part:
    """Bytes on their way into some buffers, or out of them."""

    def __init__(self, *buffers: memoryview):
        self.buffers = buffers
        self.length = sum(len(b) for b in buffers)
        self.counts: List[int] = []

    def rest(self) -> memoryview:
        """Of the first buffer that is not done; empty: all are."""
        done = sum(self.counts)
        for buffer in self.buffers:
            if done < len(buffer):
                return buffer[done:]
            done -= len(buffer)
        return memoryview(b"")


def advance(part: Part, act: Callable[[memoryview], int]) -> None:
    while rest := part.rest():
        part.counts.extend(map(act, (rest,)))
        if not part.counts[-1]:
            raise Lost("the connection to the daemon is lost")


class Mover:
    """A thread that advances parts, one after the other. Its queues are of C: those of the Python
    library, and its futures, keep a lock for ever where an exception comes at the wrong moment."""

    def __init__(self, connected: socket.socket):
        self._socket = connected
        self._steps: "queue.SimpleQueue[Any]" = queue.SimpleQueue()
        threading.Thread(target=self._run, name="lightstage-tls", daemon=True).start()

    def advance(self, part: Part, act: Callable[[memoryview], int]) -> None:
        """An interrupted wait leaves its step to be done before the next; the counts hold it."""
        answer: "queue.SimpleQueue[Optional[BaseException]]" = queue.SimpleQueue()
        self._steps.put((part, act, answer))
        if wrong := answer.get():
            raise wrong

    def close(self) -> None:
        """The socket, too, after the last step."""
        self._steps.put(None)

    def _run(self) -> None:
        while step := self._steps.get():
            part, act, answer = step
            try:
                advance(part, act)
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                answer.put(BlockingIOError())
            except BaseException as wrong:
                answer.put(wrong)
            else:
                answer.put(None)
        self._socket.close()


class Link:
    """Not blocking: progress() does what can be done, wait() waits until more can."""

    def __init__(self, connected: socket.socket, timeout: Optional[float]):
        self.socket, self.timeout = connected, timeout
        connected.setblocking(False)
        self._takes_fds = connected.family == socket.AF_UNIX
        self._mover = Mover(connected) if isinstance(connected, ssl.SSLSocket) else None
        # as much of a part as goes now; BlockingIOError if that is not all
        self._move = self._mover.advance if self._mover else advance
        self._out: Deque[Part] = collections.deque()
        self._begin()

    def _begin(self) -> None:
        self._ancillary: List[Tuple[int, List[Any], int, Any]] = []
        self._header = bytearray(HEADER.size)
        self._part = Part(memoryview(self._header))
        self._receive: Callable[[Place], None] = self._receive_header

    # ---- in ----

    def _fill(self, part: Part) -> None:
        self._move(part, self.socket.recv_into)

    def _receive_header(self, place: Place) -> None:
        part = self._part
        while self._takes_fds and sum(n for n, *_ in self._ancillary) < part.length:
            rest = memoryview(self._header)[sum(n for n, *_ in self._ancillary):]
            self._ancillary.extend(map(self.socket.recvmsg_into, ([rest],), (ANCILLARY_BYTES,),
                                       (socket.MSG_CMSG_CLOEXEC,)))
            if not self._ancillary[-1][0]:
                raise Lost("the connection to the daemon is lost")
        if not self._takes_fds:
            self._fill(part)
        fds = [fd for _, parts, _, _ in self._ancillary for level, kind, data in parts
               if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS)
               for fd, in struct.iter_unpack("i", data)]
        self._head = parse(bytes(self._header), fds)
        self._message = bytearray(self._head.message_bytes)
        self._part, self._receive = Part(memoryview(self._message)), self._receive_message

    def _receive_message(self, place: Place) -> None:
        self._fill(self._part)
        message = bytes(self._message)
        buffers, word = place(self._head, message)
        frame = Frame(self._head, message, word)
        self._part, self._frame, self._receive = Part(*buffers), frame, self._receive_payload

    def _receive_payload(self, place: Place) -> None:
        self._fill(self._part)
        self._ready: Iterator[Frame] = iter((self._frame,))
        self._receive = self._hand_over

    def _hand_over(self, place: Place) -> None:
        pass

    def receive(self, place: Place, queue: Callable[[Frame], Deque[Frame]]) -> bool:
        """Receive what is there; true once a frame was added to the queue that is its own."""
        try:
            while self._receive != self._hand_over:
                self._receive(place)
        except BlockingIOError:
            return False
        except OSError as wrong:
            raise Lost(f"the connection to the daemon is lost: {wrong}") from wrong
        queue(self._frame).extend(self._ready)  # one step, and only once
        self._begin()
        return True

    # ---- out ----

    def send(self, kind: int, request: int, message: bytes, payload: memoryview) -> None:
        """Queue a frame; flush() sends it. The payload is the caller's until then."""
        header = HEADER.pack(MAGIC, VERSION, kind, FLAG_LAST, request, len(message), 0,
                             len(payload))
        self._out.append(Part(memoryview(header + message), payload))

    def flush(self) -> bool:
        """Send what can be sent; true when all is."""
        try:
            while self._out:
                part = self._out[0]
                self._move(part, self.socket.send)
                if self._out[0] is part:
                    self._out.popleft()
        except BlockingIOError:
            return False
        except OSError:  # a daemon that hangs up says why before: that is still to be received
            self._out.clear()
        return True

    # ---- both ----

    def wait(self) -> None:
        """Until something can be received or sent. TimeoutError after `timeout` seconds without."""
        poll = select.poll()
        poll.register(self.socket, select.POLLIN | (select.POLLOUT if self._out else 0))
        if not poll.poll(None if self.timeout is None else 1000 * self.timeout):
            raise TimeoutError(f"the daemon said nothing for {self.timeout:g} s")

    def close(self) -> None:
        if self._mover:
            self._mover.close()
        else:
            self.socket.close()
