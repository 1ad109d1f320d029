#!/usr/bin/python3 -B
"""What 1,000 takes and 10,000 connections leave in the daemon's memory: nothing.

usage: leaks.py [--takes N] [--connects N]

One daemon, on six lights and a camera of 64 x 64. Its memory is looked at twenty times: of what is its
own, not some file's, the least of the third to sixth time is compared with the least of the last four.
More than 5 % of its whole resident set is a leak: 18 MB, so of 700 takes 1.3 kB each. Half a megabyte is none: an
allocator with an arena for each thread takes some hundred takes until all of them have met every size
(two runs of 1,000: 490 and 620 kB, in the last 300 takes 10 and 130; with one arena 190 kB in 400).
"""
import argparse
import signal
import sys
import tempfile
import time

import harness
import honest
import lightstage
import takes
import wire
from harness import stage

GROWTH, LOOKS = 0.05, 20
PLAN = """subject = "still";
exposures_us = [500];
darks = 2;
reference = { every = 0; };
conditions = ( { kind = "each"; channels = ["W"]; order = "given"; } );
"""


def photograph(rig, n):
    """n takes, each looked at as a client does: shown, verified, fetched, then its folder removed,
    as a daemon's memory is not to grow with the storage either."""
    with lightstage.connect(rig.path("socket"), timeout=60) as client:
        for _ in range(n):
            take = client.follow(client.start("leak", PLAN)).id
            assert client.show(take)["plan"]
            assert client.verify(take).conditions_damaged == 0
            assert client.fetch(take, "W", lights=[0]).pixels.shape == (1, 64, 64, 1)
            stage.call("rm", "-r", takes.folder(rig, take))


def connect(rig, n):
    for k in range(n):
        peer = wire.Peer(rig.path("socket"))
        if k % 2:
            peer.send(wire.hello() + wire.frame(wire.STATUS, 2))
            wire.answer(peer)
            wire.answer(peer)
        peer.close()


def flat(name, act, rig, n):
    """True if the daemon's memory has not grown while act went on."""
    sizes, began = [], time.monotonic()
    for _ in range(LOOKS):
        act(rig, n // LOOKS)
        sizes.append(honest.resident(rig))
    before, after, resident = min(sizes[2:6]), min(sizes[-4:]), honest.sizes(rig)["VmRSS"]
    print(f"{n} {name}: {before / 1e6:.2f} MB of {resident / 1e6:.1f}, at the end {after / 1e6:.2f} MB, "
          f"{(time.monotonic() - began) / n * 1e3:.1f} ms each; all: "
          f"{' '.join(f'{size / 1e6:.2f}' for size in sizes)}", flush=True)
    return after - before <= GROWTH * resident


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
