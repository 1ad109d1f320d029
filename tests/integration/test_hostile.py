#!/usr/bin/python3 -B
"""Clients that send anything at all, in any number, while a take runs: the take does not notice."""
import os
import random
import socket
import struct
import time

import harness
import takes
import wire

LONG = takes.LONG.replace('["W", "R", "G", "B"]', '["W", "R", "A", "G", "C", "B", "V", "H"]')
CONNECTIONS = 200


class Crowd:
    """What one stranger does: each verb opens one connection and leaves it in some way."""

    def __init__(self, rig, take, dice):
        self.path, self.take, self.dice = rig.path("socket"), take, dice
        self.open = []

    def peer(self, greeted=True):
        peer = wire.Peer(self.path)
        if greeted:
            peer.send(wire.hello())
            kind, _, _, _ = peer.receive() or (0, 0, b"", b"")
            assert kind == wire.HELLO | wire.REPLY, kind
        return peer

    def refused(self, peer):
        """The daemon answers with an error of class 1xx and closes."""
        answer = peer.receive()
        assert answer, "closed without a word"
        kind, _, text, _ = answer
        assert kind == wire.ERROR and text[0] == 0x08 and 100 <= text[1] < 128, answer
        assert peer.receive() is None, "the connection goes on"
        peer.close()

    def says_garbage(self):
        peer = self.peer(greeted=False)
        peer.send(self.dice.randbytes(self.dice.randint(32, 4000)))
        self.refused(peer)

    def says_garbage_after_hello(self):
        peer = self.peer()
        peer.send(self.dice.randbytes(self.dice.randint(32, 4000)))
        self.refused(peer)

    def announces_too_much(self):
        peer = self.peer()
        n = self.dice.choice((65537, 0xffffffff))
        peer.send(self.dice.choice((wire.frame(wire.STATUS, message_bytes=n),
                                    wire.frame(wire.PREFLIGHT, payload_bytes=1 << 20 | 1),
                                    wire.frame(wire.RELIGHT, payload_bytes=(1 << 64) - 1))))
        self.refused(peer)

    def asks_for_what_nobody_knows(self):
        peer = self.peer()
        peer.send(wire.frame(self.dice.choice((0, 99, 0x7fff, wire.REPLY | wire.STATUS))))
        self.refused(peer)

    def sends_a_broken_message(self):
        peer = self.peer()
        # a string that is longer than the message
        peer.send(wire.frame(wire.TAKE_SHOW, body=b"\x0a\xff\xff\x03abc"))
        self.refused(peer)

    def sends_descriptors_nobody_asked_for(self):
        """With a request, and with the first half of a header."""
        peer = self.peer()
        fds = [peer.socket.fileno()] * 200
        socket.send_fds(peer.socket, [wire.frame(wire.STATUS, 6)], fds)
        kind, _, _, _ = peer.receive()
        assert kind == wire.STATUS | wire.REPLY, kind
        socket.send_fds(peer.socket, [wire.frame(wire.STATUS, 7)[:16]], fds)
        peer.close()

    def gives_credit_and_cancels_what_is_not_there(self):
        peer = self.peer()
        fetch = wire.message(f1=self.take, f3="W", f17=1)
        peer.send(wire.frame(wire.FETCH, 2, fetch))
        for request in (2, 2, 3, (1 << 32) - 1):  # of one that counts it, of none
            peer.send(wire.frame(wire.CREDIT, 9, wire.message(f1=request, f2=(1 << 64) - 1)))
            peer.send(wire.frame(wire.CANCEL, 10, wire.message(f1=request + 1 & 0xffffffff)))
        answered = set()
        while 9 not in answered:
            kind, request, _, _ = peer.receive()
            answered.add(request)
        peer.close()

    def stops_in_the_middle(self):
        peer = self.peer(greeted=False)
        data = wire.hello() + self.request()
        peer.send(data[:self.dice.randint(1, len(data) - 1)])
        peer.close()

    def request(self):
        relight = wire.message(f1=self.take, f2=0, f3="W", f4=12)
        return self.dice.choice((
            wire.frame(wire.FETCH, 2, wire.message(f1=self.take, f3="W")),
            wire.frame(wire.RELIGHT, 3, relight, struct.pack("<12f", *[1.0] * 12)),
            wire.frame(wire.TAKE_VERIFY, 4, wire.message(f1=self.take)),
            wire.frame(wire.TAKE_PROGRESS, 5)))

    def leaves_in_the_middle_of_an_answer(self):
        peer = self.peer()
        peer.send(self.request())
        peer.read(self.dice.randint(1, wire.HEADER.size))
        peer.close()

    def asks_much_and_reads_nothing(self):
        peer = self.peer()
        for _ in range(40):
            if not peer.send(self.request()):
                break
        self.open.append(peer)
        if len(self.open) > 8:
            self.open.pop(0).close()

    def flips_bits(self):
        peer = self.peer()
        data = bytearray(self.request())
        for _ in range(self.dice.randint(1, 8)):
            bit = self.dice.randrange(8 * len(data))
            data[bit // 8] ^= 1 << bit % 8
        # one bit from TAKE_PROGRESS to TAKE_ABORT, from FETCH to BLANK: well said, and obeyed
        if wire.HEADER.unpack_from(data)[2] not in (wire.TAKE_ABORT, wire.BLANK):
            peer.send(bytes(data))
        peer.close()

    def wants_a_take_of_its_own(self):
        peer = self.peer()
        plan = self.dice.randbytes(self.dice.randint(1, 500))
        peer.send(wire.frame(wire.TAKE_START, 1, wire.message(f1="mine", f2="token"), plan))
        kind, _, _, _ = peer.receive()
        assert kind == wire.ERROR, kind
        peer.close()

    def verbs(self):
        return [getattr(self, name) for name in dir(Crowd)
                if name.split("_")[0] in ("says", "announces", "asks", "sends", "stops", "leaves",
                                          "flips", "wants", "gives")]

    def go(self):
        for peer in self.open:
            peer.close()


def descriptors(rig):
    return len(os.listdir(f"/proc/{rig.daemon.child.pid}/fd"))


def resident_mb(rig):
    with open(f"/proc/{rig.daemon.child.pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def test_a_take_does_not_notice_hostile_clients(folder):
    seed = int(os.environ.get("LS_TEST_SEED") or time.time_ns() % 1000000)
    print(f"# LS_TEST_SEED={seed}")
    rig = harness.twelve(folder, scene="stamp").start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    rig.ask("status")
    quiet, resident = descriptors(rig), resident_mb(rig)
    crowd = Crowd(rig, status["id"], random.Random(seed))
    takes.begin(rig, LONG, token="long")
    follower = takes.begin(rig, LONG, token="long", wait=True)
    visits = 0
    while visits < CONNECTIONS or follower.poll() is None:
        crowd.verbs()[visits % len(crowd.verbs())]()
        visits += 1
        assert visits < 100 * CONNECTIONS, "the take does not end"
    crowd.go()
    print(f"# {visits} connections, {len(crowd.verbs())} kinds")
    out, err = follower.communicate()
    assert follower.returncode == 0, (out, err)
    long, = [t["id"] for t in rig.takes() if t["id"] != status["id"]]
    takes.is_good(rig, long)
    takes.is_good(rig, status["id"], pixels=False)
    # one take of slack: threads and sockets that are still on their way out
    harness.wait_for("the daemon has closed what the crowd left",
                     lambda: descriptors(rig) <= quiet + 2)
    # pictures of two takes are mapped, 64 kB a connection are read: 100 MB would be a leak of
    # half a megabyte for every visit
    assert resident_mb(rig) < resident + 100, (resident, resident_mb(rig))


def test_two_hundred_connections_at_once_leave_room_for_none_and_the_take_alone(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    take = takes.begin(rig, LONG)
    takes.fire(rig, takes.FIRST_DARK + 3)
    peers = [wire.Peer(rig.path("socket")) for _ in range(CONNECTIONS)]
    for peer in peers:
        peer.send(wire.hello())
    answers = [peer.receive() for peer in peers]
    served = [a for a in answers if a and a[0] == wire.HELLO | wire.REPLY]
    away = [a for a in answers if a and a[0] == wire.ERROR]
    assert len(served) == 64 and len(away) == CONNECTIONS - 64, (len(served), len(away))
    assert b"64" in away[0][2], away[0]
    for peer in peers:
        peer.close()
    harness.wait_for("there is room again", lambda: takes.ask(rig, "status")[0] == 0)
    code, status = takes.ended(rig)
    assert code == 0 and status["id"] == take, status
    takes.is_good(rig, take)


if __name__ == "__main__":
    harness.main(globals())
