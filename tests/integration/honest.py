"""A client that does what it should, in a process of its own, while others do not."""
import multiprocessing
import time
import zlib

import wire

LAST = 1  # of a frame's flags


def answer(peer):
    """(kind, last message, crc of all payloads) of a request's frames up to the last one."""
    crc = 0
    while True:
        head = peer.read(wire.HEADER.size)
        assert len(head) == wire.HEADER.size, "the connection ended"
        _, _, kind, flags, _, n, _, more = wire.HEADER.unpack(head)
        message = peer.read(n)
        crc = zlib.crc32(peer.read(more), crc)
        if flags & LAST:
            return kind, message, crc


def greeted(path):
    peer = wire.Peer(path)
    peer.send(wire.hello())
    kind, _, _ = answer(peer)
    assert kind == wire.HELLO | wire.REPLY, kind
    return peer


def _serve(path, take, stop, pipe):
    ask = {"status": wire.frame(wire.STATUS, 1),
           "fetch": wire.frame(wire.FETCH, 2, wire.message(f1=take, f3="W", f2=0))}
    kinds = {"status": wire.STATUS | wire.REPLY, "fetch": wire.FETCH | wire.REPLY}
    seconds, first, wrong = {name: [] for name in ask}, None, None
    try:
        peer = greeted(path)
        while not stop.is_set() and not wrong:
            for name, request in ask.items():
                began = time.monotonic()
                peer.send(request)
                kind, message, crc = answer(peer)
                seconds[name].append(time.monotonic() - began)
                first = crc if name == "fetch" and first is None else first
                if kind != kinds[name] or (name == "fetch" and crc != first):
                    wrong = f"{name}: frame {kind:#x} {message!r}, crc {crc:#x}, first {first}"
            if len(seconds["status"]) == 1:
                pipe.send("ready")
            time.sleep(0.005)  # a person's client, not a flood of its own
    except (AssertionError, OSError) as error:
        wrong = repr(error)
    pipe.send((wrong, seconds))


class Client:
    """Asks for the status and for a light's picture until it is told to stop."""

    def __init__(self, path, take):
        context = multiprocessing.get_context("fork")
        self.stop, (self.pipe, other) = context.Event(), context.Pipe()
        self.process = context.Process(target=_serve, args=(path, take, self.stop, other),
                                       daemon=True)
        self.process.start()
        said = self.pipe.recv()
        assert said == "ready", said

    def ended(self):
        """Every answer was right; the seconds that each took, by request."""
        self.stop.set()
        assert self.pipe.poll(30), "the honest client waits for an answer"
        wrong, seconds = self.pipe.recv()
        self.process.join(10)
        assert not wrong, wrong
        return seconds


def resident(rig):
    """Bytes of the daemon's memory that are its own: pictures that it has mapped are the
    kernel's to take back."""
    with open(f"/proc/{rig.daemon.child.pid}/status", encoding="ascii") as file:
        fields = dict(line.split(":", 1) for line in file)
    return 1024 * int(fields["RssAnon"].split()[0])


