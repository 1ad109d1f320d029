"""Requests and their answers over one link. One thread at a time; many requests may overlap."""
import collections
import os
import socket
import ssl
from typing import Any, Callable, Deque, Dict, Iterator, List, NamedTuple, Optional, Tuple
from urllib.parse import urlsplit

from . import lightstage_pb2 as messages
from .errors import Error, Lost, Refused
from .link import Frame, Head, Link

HELLO, STATUS, RIG, PREFLIGHT, TAKE_START, TAKE_PROGRESS, TAKE_ABORT, TAKE_RESUME, TAKE_LIST, \
    TAKE_SHOW, TAKE_VERIFY, FETCH, RELIGHT, BLANK, CANCEL, TAKE_SLATE, METRICS, PREVIEW, EVENTS, \
    CREDIT, RING = range(1, 22)
REPLY, ERROR = 0x8000, 0xffff
DEFAULT_SOCKET = "/run/lightstaged/socket"
DEFAULT_PORT = 7472
CONNECT_SECONDS = 10.0  # for a daemon on another machine, where no timeout was asked for
DISCARD_BYTES = 1 << 18

ANSWERS: Dict[int, Any] = {
    HELLO: messages.HelloReply, STATUS: messages.StatusReply, RIG: messages.RigReply,
    PREFLIGHT: messages.PreflightReply, TAKE_START: messages.TakeStartReply,
    TAKE_PROGRESS: messages.TakeStatus, TAKE_ABORT: messages.TakeAbortReply,
    TAKE_RESUME: messages.TakeStartReply, TAKE_LIST: messages.TakeListReply,
    TAKE_SHOW: messages.TakeShowReply, TAKE_VERIFY: messages.TakeVerifyReply,
    FETCH: messages.FetchReply, RELIGHT: messages.RelightReply, BLANK: messages.BlankReply,
    CANCEL: messages.CancelReply, TAKE_SLATE: messages.TakeSlateReply,
    METRICS: messages.MetricsReply, PREVIEW: messages.PreviewReply, EVENTS: messages.EventsReply,
    CREDIT: messages.CreditReply, RING: messages.RingReply}


class Answer(NamedTuple):
    message: Any         # of the request's own kind
    payload: memoryview  # of the buffers that it went to, the first
    fds: List[int]       # the receiver's to close


# Buffers for the payload of an answer, its length in all.
Room = Callable[[Any, int], List[memoryview]]


def new_room(message: Any, n: int) -> List[memoryview]:
    return [memoryview(bytearray(n))]


class Request:
    """An iterator over the answers to one request. Leaving it before its end cancels it: use `with`.

    A message with `credit_bytes` is answered so far ahead of the iterator, and no farther: what an
    answer weighed is given back once the next is asked for."""

    def __init__(self, connection: "Connection", kind: int, message: Any, payload: bytes,
                 room: Room):
        self.kind, self.room, self.connection = kind, room, connection
        self.frames: Deque[Frame] = collections.deque()
        self.credit: int = getattr(message, "credit_bytes", 0)
        self.owed = 0
        self.ended = self.abandoned = False
        self.number = connection.register(self)
        connection.link.send(kind, self.number, message.SerializeToString(), memoryview(payload))

    def __enter__(self) -> "Request":
        return self

    def __exit__(self, *_: Any) -> None:
        self.cancel()

    def __iter__(self) -> Iterator[Answer]:
        return self

    def __next__(self) -> Answer:
        if self.ended:
            raise StopIteration
        if self.credit and 2 * self.owed >= self.credit:
            self.connection.tell(CREDIT, messages.Credit(request=self.number, bytes=self.owed))
            self.owed = 0
        while not self.frames:
            self.connection.receive()
        frame = self.frames.popleft()
        self.ended = frame.head.last
        if self.ended:
            self.connection.forget(self)
        message, buffers = frame.place
        self.owed += weight(message, frame.head.payload_bytes)
        if frame.head.kind == ERROR:
            raise Refused(message.number, message.text)
        return Answer(message, buffers[0] if buffers else memoryview(b""), frame.head.fds)

    def only(self) -> Answer:
        """The answer to a request that has one."""
        with self:
            for answer in self:
                return answer
        raise Error("the daemon ended a request without an answer")

    def cancel(self) -> None:
        """The daemon stops; what it has sent by then is received later, and dropped."""
        if self.ended or self.abandoned:
            return
        self.abandoned = True
        last = any(frame.head.last for frame in self.frames)
        while self.frames:
            close_all(self.frames.popleft().head.fds)
        if last:
            self.connection.forget(self)
        elif not self.connection.closed:
            self.connection.tell(CANCEL, messages.Cancel(request=self.number))


def tiles_sent(message: Any) -> int:
    """Of those that an answer lists: not what the client has, nor what is left out (hash 0)."""
    return len(message.tile) - sum(message.tile_unchanged) - list(message.tile_hash).count(0)


def weight(message: Any, payload_bytes: int) -> int:
    """Of an answer, as credit counts: its payload, or the tiles that it hands over."""
    if not getattr(message, "memfd", False):
        return payload_bytes
    value = 2 if message.sample == messages.HALF else 4
    return int(tiles_sent(message) * 64 * 64 * message.components * value)


def close_all(fds: List[int]) -> None:
    while fds:
        os.close(fds.pop())


class Connection:
    def __init__(self, connected: socket.socket, timeout: Optional[float], name: str):
        self.link = Link(connected, timeout)
        self.closed = False
        self._requests: Dict[int, Request] = {}
        self._last = 0
        self._dropped: Deque[Frame] = collections.deque(maxlen=1)
        self._scratch = memoryview(bytearray(0))
        try:
            self.hello: messages.HelloReply = self.ask(HELLO, messages.Hello(
                version=1, client=name)).message
        except BaseException:
            self.close()
            raise

    def register(self, request: Request) -> int:
        if self.closed:
            raise Lost("the connection is closed")
        self._last += 1
        self._requests[self._last] = request
        return self._last

    def forget(self, request: Request) -> None:
        self._requests.pop(request.number, None)

    def request(self, kind: int, message: Any, payload: bytes = b"",
                room: Room = new_room) -> Request:
        request = Request(self, kind, message, payload, room)
        self.link.flush()
        return request

    def ask(self, kind: int, message: Any, payload: bytes = b"") -> Answer:
        return self.request(kind, message, payload).only()

    def tell(self, kind: int, message: Any) -> None:
        """A request whose answer says nothing."""
        self.request(kind, message).abandoned = True

    def receive(self) -> None:
        """One frame, for whichever request it answers; returns early where none is there yet."""
        if self.closed:
            raise Lost("the connection is closed")
        try:
            self.link.flush()
            if not self.link.receive(self._place, self._queue):
                self.link.wait()
        except (Lost, Refused):  # what is refused here is the connection itself
            self.close()
            raise

    def close(self) -> None:
        self.closed = True
        self.link.close()
        for request in self._requests.values():
            for frame in request.frames:
                close_all(frame.head.fds)

    # ---- of the link ----

    def _place(self, head: Head, message: bytes) -> Tuple[List[memoryview], Any]:
        request = self._requests.get(head.request)
        if head.kind == ERROR:
            error = messages.Error.FromString(message)
            if head.request == 0:
                raise Refused(error.number, error.text)
            return self._discard(head.payload_bytes), (error, [])
        if request is None or request.abandoned:
            close_all(head.fds)
            return self._discard(head.payload_bytes), (None, [])
        if head.kind != request.kind + REPLY:
            raise Lost(f"the daemon answered request {request.kind} with {head.kind}")
        answer = ANSWERS[request.kind].FromString(message)
        buffers = request.room(answer, head.payload_bytes)
        if sum(len(b) for b in buffers) != head.payload_bytes:
            raise Lost(f"{head.payload_bytes} bytes came with an answer that has "
                       f"{sum(len(b) for b in buffers)}")
        return buffers, (answer, buffers)

    def _queue(self, frame: Frame) -> Deque[Frame]:
        request = self._requests.get(frame.head.request)
        if request is None or request.abandoned:
            if request and frame.head.last:
                self.forget(request)
            return self._dropped
        return request.frames

    def _discard(self, n: int) -> List[memoryview]:
        if n and not self._scratch:
            self._scratch = memoryview(bytearray(DISCARD_BYTES))
        whole, rest = divmod(n, DISCARD_BYTES)
        return [self._scratch] * whole + ([self._scratch[:rest]] if rest else [])


def open_socket(address: str, context: Optional[ssl.SSLContext],
                timeout: Optional[float]) -> socket.socket:
    """A connected socket. `address`: a path, or tls://HOST[:PORT]."""
    if not address.startswith("tls://"):
        local = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        local.settimeout(timeout)
        try:
            local.connect(address)
        except OSError as wrong:
            local.close()
            raise Lost(f"no lightstaged answers at {address}: {wrong.strerror or wrong}") from wrong
        return local
    where = urlsplit(address)
    if context is None or not where.hostname:
        raise ValueError(f"{address}: expected tls://HOST:PORT")
    try:
        plain = socket.create_connection((where.hostname, where.port or DEFAULT_PORT),
                                         timeout or CONNECT_SECONDS)
        try:
            return context.wrap_socket(plain, server_hostname=where.hostname)
        except BaseException:
            plain.close()
            raise
    except OSError as wrong:
        raise Lost(f"no lightstaged answers at {address}: {wrong}") from wrong


def tls_context(certificate: Optional[str], key: Optional[str],
                authority: Optional[str]) -> ssl.SSLContext:
    """Who we are, and whom we believe: nobody but this authority."""
    if not certificate or not key or not authority:
        raise ValueError("a daemon on another machine: certificate, key and authority are needed")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.load_verify_locations(authority)
    context.load_cert_chain(certificate, key)
    return context
