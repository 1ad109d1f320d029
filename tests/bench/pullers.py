#!/usr/bin/python3 -B
"""Sixteen clients that pull a take's picture over and over while another take runs; four of them
never read. Says "pulling" when all are served, and on SIGTERM how many bytes they were given.

usage: pullers.py SOCKET TAKE LIGHT CHANNEL
"""
import os
import select
import signal
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))),
                                "integration"))

import wire  # noqa: E402

CLIENTS, STALLED = 16, 4
AHEAD = 2  # requests that a client has under way


class Counted(wire.Peer):
    total = 0

    def read(self, n):
        out = super().read(n)
        self.total += len(out)
        return out


def answer_bytes(path, request):
    peer = Counted(path)
    peer.send(wire.hello())
    wire.answer(peer)
    greeting = peer.total
    peer.send(request)
    kind, message, _ = wire.answer(peer)
    assert kind == wire.FETCH | wire.REPLY, message
    peer.close()
    return peer.total - greeting


def main():
    # a render node's processors are not this machine's
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    path, take, light, channel = sys.argv[1:]
    request = wire.frame(wire.FETCH, 2, wire.message(f1=take, f2=int(light), f3=channel))
    size = answer_bytes(path, request)
    peers = [wire.greeted(path) for _ in range(CLIENTS)]
    for peer in peers:
        peer.send(request * AHEAD)
    reading = {peer.socket: 0 for peer in peers[STALLED:]}  # bytes of the answer under way
    buffer, total = bytearray(1 << 20), 0

    def end(*_):
        print(total, flush=True)
        os._exit(0)
    signal.signal(signal.SIGTERM, end)
    print("pulling", flush=True)
    while True:
        for ready in select.select(list(reading), [], [])[0]:
            n = ready.recv_into(buffer)
            assert n, "the daemon closed the connection of a client that reads"
            total += n
            answers, reading[ready] = divmod(reading[ready] + n, size)
            ready.sendall(request * answers)


if __name__ == "__main__":
    main()
