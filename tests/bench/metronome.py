#!/usr/bin/python3 -B
"""How often a processor stands still for everybody: what a virtual machine's host takes from it.

usage: metronome.py PROCESSOR

Before all other threads of it, wakes each millisecond; on SIGTERM prints the pauses longer than
LONG_MS, in ms, on a line. Ends with 3 where nobody may be preferred so.
"""
import os
import signal
import sys
import time

LONG_MS = 8  # half of a frame's period at 72 frames a second


def main():
    os.sched_setaffinity(0, [int(sys.argv[1])])
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_max(os.SCHED_FIFO)))
    except PermissionError:
        return 3
    pauses = []

    def end(*_):
        print(*(f"{ms:.1f}" for ms in pauses), flush=True)
        os._exit(0)
    signal.signal(signal.SIGTERM, end)
    print("ticking", flush=True)
    then = time.monotonic()
    while True:
        time.sleep(0.001)
        now = time.monotonic()
        if (now - then) * 1e3 > LONG_MS:
            pauses.append((now - then) * 1e3)
        then = now


if __name__ == "__main__":
    sys.exit(main())
