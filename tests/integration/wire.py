"""The protocol's bytes by hand, from proto/PROTOCOL.md, so that wrong ones can be sent too."""
import socket
import struct
import zlib

HEADER = struct.Struct("<4sHHIIIIQ")
HELLO, STATUS, RIG, PREFLIGHT, TAKE_START, TAKE_PROGRESS, TAKE_ABORT = range(1, 8)
TAKE_RESUME, TAKE_LIST, TAKE_SHOW, TAKE_VERIFY, FETCH, RELIGHT, BLANK, CANCEL = range(8, 16)
CREDIT = 20
REPLY, ERROR = 0x8000, 0xffff
LAST = 1  # of a frame's flags


def varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out) + bytes([value])


def message(**fields):
    """f3=7 or f1="text": field numbers and their values, numbers or strings."""
    out = b""
    for name, value in fields.items():
        number = int(name[1:])
        if isinstance(value, int):
            out += varint(number << 3) + varint(value)
        else:
            text = value.encode()
            out += varint(number << 3 | 2) + varint(len(text)) + text
    return out


def frame(kind, request=1, body=b"", payload=b"", message_bytes=None, payload_bytes=None,
          magic=b"LSTG", version=1, flags=0, reserved=0):
    """A frame; the lengths may lie."""
    return HEADER.pack(magic, version, kind, flags, request,
                       len(body) if message_bytes is None else message_bytes, reserved,
                       len(payload) if payload_bytes is None else payload_bytes) + body + payload


def hello():
    return frame(HELLO, body=message(f1=1, f2="test"))


class Peer:
    """One connection; what it sends is up to the test."""

    def __init__(self, path, seconds=10):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(path)  # waits for its turn when others knock too
        self.socket.settimeout(seconds)

    def send(self, data):
        """False if the daemon has closed the connection by now."""
        try:
            self.socket.sendall(data)
        except OSError:
            return False
        return True

    def read(self, n):
        """n bytes, or fewer if the connection ended."""
        out = b""
        try:
            while len(out) < n:
                more = self.socket.recv(n - len(out))
                if not more:
                    break
                out += more
        except ConnectionError:
            pass
        return out

    def receive(self):
        """(type, request, message, payload) of the next frame, or None at the end."""
        head = self.read(HEADER.size)
        if len(head) < HEADER.size:
            return None
        _, _, kind, _, request, n, _, more = HEADER.unpack(head)
        return kind, request, self.read(n), self.read(more)

    def close(self):
        self.socket.close()


def answer(peer):
    """(kind, last message, crc of all payloads) of a request's frames up to the last one."""
    crc = 0
    while True:
        head = peer.read(HEADER.size)
        assert len(head) == HEADER.size, "the connection ended"
        _, _, kind, flags, _, n, _, more = HEADER.unpack(head)
        message = peer.read(n)
        crc = zlib.crc32(peer.read(more), crc)
        if flags & LAST:
            return kind, message, crc


def greeted(path):
    peer = Peer(path)
    peer.send(hello())
    kind, _, _ = answer(peer)
    assert kind == HELLO | REPLY, kind
    return peer
