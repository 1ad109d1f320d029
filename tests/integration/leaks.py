#!/usr/bin/python3 -B
"""What 1,000 takes and 10,000 connections leave in the daemon's memory: nothing.

usage: leaks.py [--takes N] [--connects N]

One daemon, on six lights and a camera of 64 x 64. Its own memory after a tenth of each, when every
part of it has been at work, is compared with that at the end: more than 5 % is a leak.
"""
import argparse
import os
import signal
import sys
import tempfile
import time

import harness
import honest
import takes
import wire
from harness import stage

GROWTH = 1.05
PLAN = """subject = "still";
exposures_us = [500];
darks = 2;
reference = { every = 0; };
conditions = ( { kind = "each"; channels = ["W"]; order = "given"; } );
"""


def photograph(rig, n):
    """n takes, each looked at as a client does: shown, verified, fetched, then its folder removed,
    as a daemon's memory is not to grow with the storage either."""
    peer = honest.greeted(rig.path("socket"))
    for _ in range(n):
        peer.send(wire.frame(wire.TAKE_START, 1, wire.message(f1="leak", f2=f"t{time.time_ns()}"),
                             PLAN.encode()))
        kind, message, _ = honest.answer(peer)
        assert kind == wire.TAKE_START | wire.REPLY, message
        peer.send(wire.frame(wire.TAKE_PROGRESS, 2))
        kind, message, _ = honest.answer(peer)
        assert kind == wire.TAKE_PROGRESS | wire.REPLY, message
        take, = os.listdir(rig.path("takes"))
        for request in (wire.frame(wire.TAKE_SHOW, 3, wire.message(f1=take)),
                        wire.frame(wire.TAKE_VERIFY, 4, wire.message(f1=take)),
                        wire.frame(wire.FETCH, 5, wire.message(f1=take, f2=0, f3="W"))):
            peer.send(request)
            kind, message, _ = honest.answer(peer)
            assert kind != wire.ERROR, message
        stage.call("rm", "-r", takes.folder(rig, take))
    peer.close()


def connect(rig, n):
    for k in range(n):
        peer = wire.Peer(rig.path("socket"))
        if k % 2:
            peer.send(wire.hello() + wire.frame(wire.STATUS, 2))
            honest.answer(peer)
            honest.answer(peer)
        peer.close()


def flat(name, act, rig, n):
    """True if the last nine tenths of n grew nothing."""
    act(rig, n // 10)
    before, began = honest.resident(rig), time.monotonic()
    act(rig, n - n // 10)
    after = honest.resident(rig)
    print(f"{n} {name}: {before / 1e6:.2f} MB after the first tenth, {after / 1e6:.2f} MB at the "
          f"end, {(time.monotonic() - began) / (n - n // 10) * 1e3:.1f} ms each", flush=True)
    return after <= GROWTH * before


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--takes", type=int, default=1000)
    parser.add_argument("--connects", type=int, default=10000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ls-leaks-") as folder:
        rig = harness.rig_of(folder, scene_extra="lights = 6;", size=64).start()
        try:
            good = [flat("takes", photograph, rig, given.takes),
                    flat("connections", connect, rig, given.connects)]
        finally:
            complaints = rig.stop()
    for complaint in complaints:
        print(complaint)
    print(f"{sum(good)} passed, {len(good) - sum(good)} failed")
    return 0 if all(good) and not complaints else 1


if __name__ == "__main__":
    sys.exit(main())
