#!/usr/bin/python3 -B
"""Devices that accept and stay silent: who waits for them, and who does not."""
import contextlib
import signal
import socket
import statistics
import threading
import time

import harness
import wire

PROMPT_S = 0.2  # what another client may have to wait: it is answered from memory
END_S = 10  # what opening a camera costs in timeouts, several registers of 2.5 s apart


@contextlib.contextmanager
def silent_camera(rig):
    """In the place of the rig's: a socket that takes every packet and answers none; its name, and a
    function that waits until it is asked something."""
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    address = rig.addresses[0].rsplit(".", 1)[0] + ".99"
    port.bind((address, 3956))
    port.settimeout(30)
    rig.addresses = [address]
    with port:
        yield f"camera 0 ({address})", lambda: port.recv(4096)


@contextlib.contextmanager
def silent_controller(rig):
    """The kernel accepts connections for a stopped simulator."""
    rig.dome.child.send_signal(signal.SIGSTOP)
    try:
        yield "dome controller"
    finally:
        rig.dome.child.send_signal(signal.SIGCONT)


def prompt(rig, kind, answer=None):
    """Ask on a connection of its own; how long the answer took, connection and greeting included."""
    began = time.monotonic()
    peer = wire.Peer(rig.path("socket"))
    peer.send(wire.hello() + wire.frame(kind, 2))
    peer.receive()
    got = peer.receive()[0]
    peer.close()
    assert got == (answer or kind | wire.REPLY), got
    return time.monotonic() - began


class Hanging:
    """A request under way, asked on a connection of its own."""

    def __init__(self, rig, kind, body=b"", payload=harness.PLAN.encode()):
        self.peer = wire.Peer(rig.path("socket"), seconds=30)
        self.peer.send(wire.hello())
        self.peer.receive()
        self.peer.send(wire.frame(kind, 7, body, payload))
        self.answer = None
        self.thread = threading.Thread(target=self.wait)
        self.thread.start()

    def wait(self):
        self.answer = self.peer.receive()

    def hangs(self):
        return self.thread.is_alive()

    def end(self):
        self.thread.join(30)
        self.peer.close()
        return self.answer


def others_are_answered(rig, device, kind, body=b""):
    """While a request waits for the device; which ends with an error that names it."""
    hanging = Hanging(rig, kind, body)
    took = [prompt(rig, kind) for kind in 3 * (wire.TAKE_LIST, wire.STATUS, wire.RIG)]
    assert hanging.hangs(), "they, too, were answered after it"
    # a daemon that waits holds them all; a busy machine holds some
    assert statistics.median(took) < PROMPT_S, took
    kind, request, message, _ = hanging.end()
    assert (kind, request) == (wire.ERROR, 7), (kind, message)
    assert device.encode() in message, message


def test_a_silent_camera_stops_no_other_client(folder):
    rig = harness.twelve(folder)
    rig.start_simulator()
    with silent_camera(rig) as (device, _):
        rig.start_daemon()
        others_are_answered(rig, device, wire.PREFLIGHT)
        others_are_answered(rig, device, wire.TAKE_START, wire.message(f1="a", f2="token"))
        assert rig.takes() == []


def test_a_silent_controller_stops_no_other_client(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("whole", harness.PLAN, "--no-wait")
    rig.control("take", "abort")
    harness.wait_for("it has ended", lambda: rig.takes()[-1]["state"] == "aborted")
    with silent_controller(rig) as device:
        others_are_answered(rig, device, wire.PREFLIGHT)
        others_are_answered(rig, device, wire.TAKE_RESUME, wire.message(f1=take, f2="again"))
    rig.control("take", "resume", take)  # it answers again


def test_a_hanging_preflight_is_cancelled_aborted_and_outlived(folder):
    rig = harness.twelve(folder)
    rig.start_simulator()
    with silent_camera(rig) as (device, is_asked):
        rig.start_daemon()
        start = Hanging(rig, wire.TAKE_START, wire.message(f1="a", f2="token"))
        is_asked()
        prompt(rig, wire.TAKE_ABORT)
        kind, _, message, _ = start.end()
        assert kind == wire.ERROR and (b"aborted" in message or device.encode() in message), message
        assert rig.takes() == []
        cancelled = Hanging(rig, wire.PREFLIGHT)
        is_asked()
        cancelled.peer.send(wire.frame(wire.CANCEL, 8, wire.message(f1=7)))
        kind, request, message, _ = cancelled.end()
        assert (kind, request) == (wire.ERROR, 7) and b"cancelled" in message, message
        last = Hanging(rig, wire.PREFLIGHT)
        prompt(rig, wire.RIG)  # it has been read by then
        assert last.hangs()
        began = time.monotonic()
        rig.daemon.child.send_signal(signal.SIGTERM)
        assert last.end()[0] == wire.ERROR
        assert rig.daemon.child.wait(30) == 0
        assert time.monotonic() - began < END_S
    assert harness.shown(rig) == [], "it fired"


if __name__ == "__main__":
    harness.main(globals())
