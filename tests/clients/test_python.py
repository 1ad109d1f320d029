#!/usr/bin/python3 -B
"""The Python package against bytes that are written down, or that a script sends: no daemon."""
import fcntl
import functools
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import zlib

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "integration"))

import harness  # noqa: E402
import lightstage  # noqa: E402
import wire  # noqa: E402
from lightstage import connection, messages  # noqa: E402
from lightstage.factored import expand  # noqa: E402
from lightstage.ring import Ring  # noqa: E402
from lightstage.stage import Stage  # noqa: E402
from lightstage.tiles import mapped  # noqa: E402

# protobuf has no types on Debian, and what protoc writes is protoc's
MYPY = """[mypy]
strict = true
warn_return_any = false
[mypy-google.*]
ignore_missing_imports = true
[mypy-lightstage.lightstage_pb2]
ignore_errors = true
"""
PLAN = 'subject = "still";\n'


def transcript():
    """proto/PROTOCOL.md's: (what the client says, what the daemon says), as bytes."""
    text = harness.stage.read(os.path.join(harness.ROOT, "proto", "PROTOCOL.md"))
    said = {">": b"", "<": b""}
    for who, lines in re.findall(r"^    ([<>]) \w+ \d+.*\n((?:    (?:[0-9a-f]{2} ?)+\n?)+)", text, re.M):
        said[who] += bytes.fromhex("".join(lines.split()))
    return said[">"], said["<"]


def test_a_connection_is_the_one_that_the_protocol_writes_down(folder):
    ours, theirs = transcript()
    client, daemon = socket.socketpair()
    daemon.sendall(theirs)  # it has answered before it is asked: order is all that counts
    connected = connection.Connection(client, 10, "transcript")
    with Stage(connected) as stage:
        rig = stage.rig()
        assert rig.name == "test rig" and [c.name for c in rig.channels] == ["W", "R"]
        assert rig.positions_m.tolist() == [[0, 1, 0], [0, 0, 1.5]], rig.positions_m
        assert "fetch" in stage.capabilities
        assert stage.start("vase", PLAN, "7f3a").state == messages.PREPARING
        follow = stage.progress("7f3a")
        assert next(follow).state == messages.PREPARING
        assert next(follow).progress.steps_bound == 40
        assert stage.start("vase", PLAN, "7f3a").state == messages.RUNNING
        refused(201, "is running", lambda: stage.start("vase", PLAN, "0b0b"))
        end, = follow
        assert end.state == messages.COMPLETE and end.report.seconds == 2
        refused(200, "no take is running", stage.abort)
        refused(102, "is not a request", lambda: connected.ask(0x77, messages.Status()))
    said = b""
    while more := daemon.recv(65536):
        said += more
    assert said == ours, "the client says something else than the protocol has"


def refused(number, words, act):
    try:
        act()
    except lightstage.Refused as wrong:
        assert wrong.number == number and words in wrong.sentence, wrong
        return
    raise AssertionError(f"not refused with {number}")


def test_refusals_have_the_numbers_and_names_of_the_protocol(folder):
    text = harness.stage.read(os.path.join(harness.ROOT, "proto", "errors.h"))
    theirs = {name: int(value) for name, value in re.findall(r"LS_PROTO_(\w+) = (\d+)", text)}
    assert theirs == {n.name: int(n) for n in lightstage.Number} and theirs
    new = lightstage.Refused(299, "Something.")
    assert new.number == 299 and str(new) == "Something. (299 error)"


class Daemon(threading.Thread):
    """Says what a script says, to one client; ends when the client does. `rows` of a picture `width`
    wide come in bands of `band`, their values count from `first` on."""

    def __init__(self):
        super().__init__(daemon=True)
        self.ours, self.client = socket.socketpair()
        self.cancelled = 0
        self.start()

    def run(self):
        peer = wire.Peer.__new__(wire.Peer)
        peer.socket = self.ours
        self.ours.settimeout(60)
        while asked := peer.receive():
            kind, number, message, _ = asked
            answer = getattr(self, f"on_{kind}", None)
            peer.send(b"".join(answer(number, message)) if answer else wire.frame(
                kind | wire.REPLY, number, flags=1))

    def on_12(self, number, message):  # Fetch
        asked = messages.Fetch.FromString(message)
        width, height, band = asked.region.width, asked.region.height, 64
        for light in asked.lights:
            for row in range(0, height, band):
                n = min(band, height - row)
                reply = messages.FetchReply(light=light, width=width, height=height, n_rows=n,
                                            first_row=row, components=1)
                yield wire.frame(wire.FETCH | wire.REPLY, number, reply.SerializeToString(),
                                 values(light, width, row, n).tobytes(),
                                 flags=light == asked.lights[-1] and row + n == height)

    def on_15(self, number, message):  # Cancel: it has been answered whole by then
        self.cancelled += 1
        yield wire.frame(wire.CANCEL | wire.REPLY, number, flags=1)


@functools.lru_cache(None)
def values(light, width, row, n):
    first = np.float32(light) * 1000 + row
    return np.repeat(np.arange(n, dtype="<f4") + first, width)


def stage_of(daemon, timeout=60):
    return Stage(connection.Connection(daemon.client, timeout, "test"))


class Interrupted(Exception):
    pass


def raise_interrupted(*_):
    raise Interrupted


def test_an_exception_at_any_moment_loses_no_byte_of_the_connection(folder):
    seed = int(os.environ.get("LS_TEST_SEED", time.time()))
    dice, hit = random.Random(seed), 0
    print(f"# seed {seed}")
    daemon = Daemon()
    before = signal.signal(signal.SIGALRM, raise_interrupted)
    region, lights = (0, 0, 512, 500), range(2)
    expected = np.stack([values(light, 512, 0, 500).reshape(500, 512) for light in lights])
    try:
        with stage_of(daemon) as stage:
            rounds = took = 0
            while hit < 40 or daemon.cancelled < 10:
                rounds += 1
                try:
                    signal.setitimer(signal.ITIMER_REAL, 1e-5 + dice.uniform(0, took))
                    stage.fetch("take", "W", lights=lights, region=region)
                    signal.setitimer(signal.ITIMER_REAL, 0)
                except Interrupted:
                    hit += 1
                began = time.monotonic()
                got = stage.fetch("take", "W", lights=lights, region=region)
                took = time.monotonic() - began
                assert np.array_equal(got.pixels[..., 0], expected), f"round {rounds}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    print(f"# interrupted {hit} of {rounds} times, {daemon.cancelled} cancelled")


def test_requests_overlap_and_each_gets_its_own(folder):
    with stage_of(Daemon()) as stage:
        def pictures(*lights):
            return stage.pictures("take", "W", lights=lights, region=(0, 0, 8, 100))
        with_one, with_two = pictures(1, 3), pictures(2, 4, 5)
        order = [next(with_one), next(with_two), next(with_two), *with_one, *with_two]
        assert [p.light for p in order] == [1, 2, 4, 3, 5]
        for picture in order:
            assert np.array_equal(picture.pixels.ravel(), values(picture.light, 8, 0, 100))


def test_pictures_are_received_into_the_callers_array_or_it_is_refused(folder):
    with stage_of(Daemon()) as stage:
        def fetch(out):
            return stage.fetch("take", "W", lights=[7, 2], region=(0, 0, 8, 100), out=out)
        out = np.zeros((2, 100, 8, 1), np.float32)
        got = fetch(out)
        assert got.pixels.base is out and got.lights == [7, 2]
        assert np.array_equal(out[1].ravel(), values(2, 8, 0, 100))
        for wrong in (np.zeros((2, 100, 8, 1)), np.zeros((2, 100, 9, 1), np.float32),
                      np.zeros((2, 100, 16, 1), np.float32)[:, :, ::2]):
            try:
                fetch(wrong)
            except ValueError as said:
                assert "expected a C-contiguous, writable array of float32 (2, 100, 8, 1)" in str(said)
            else:
                raise AssertionError("taken")
        assert fetch(out).lights == [7, 2]  # and the connection goes on


def test_shared_memory_that_could_change_or_is_too_short_is_refused(folder):
    lengths, future_write = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW, 0x10
    tile = messages.FetchReply(width=64, height=64, components=1, tile=[0], tile_hash=[1], memfd=True,
                               memfd_bytes=64 * 64 * 4)
    ring = messages.RingReply(slots=1, stride=4096, payload_bytes=4096, index_at=4096, bytes=8192)
    head = b"LSRING 1" + b"".join(n.to_bytes(8, "little") for n in (1, 4096, 4096))

    def tiles(fds):
        return mapped(tile, fds).ravel().tolist() == 4096 * [0]

    def frames(fds):
        return Ring(ring, fds).newest() is None

    for read, size, seals, sentence in (
            (tiles, 16384, lengths | fcntl.F_SEAL_WRITE, None),
            (tiles, 16384, 0, "its seals are 0x0, expected 0xe"),
            (tiles, 16384, lengths, "its seals are 0x6, expected 0xe"),
            (tiles, 16383, lengths | fcntl.F_SEAL_WRITE, "shorter than the 16384 bytes"),
            (frames, 8192, lengths | future_write, None),
            (frames, 8192, lengths, "its seals are 0x6, expected 0x16"),
            (frames, 8191, lengths | future_write, "shorter than the 8192 bytes")):
        memory = os.memfd_create("test", os.MFD_ALLOW_SEALING)
        os.pwrite(memory, head, 4096 if read is frames else size)
        os.truncate(memory, size)
        fcntl.fcntl(memory, fcntl.F_ADD_SEALS, seals)
        fds = [memory]
        try:
            assert read(fds) and not sentence, (seals, size)
        except lightstage.Error as said:
            assert sentence and sentence in str(said), said
        finally:
            connection.close_all(fds)


def test_a_connection_that_ends_is_lost_and_a_silent_one_times_out(folder):
    daemon = Daemon()
    stage = stage_of(daemon, timeout=0.2)
    daemon.on_2 = lambda number, message: []
    try:
        stage.status()
    except TimeoutError as said:
        assert "0.2 s" in str(said)
    daemon.ours.shutdown(socket.SHUT_RDWR)
    for _ in range(2):
        try:
            stage.rig()
        except lightstage.Lost as said:
            assert "lost" in str(said) or "closed" in str(said), said
        else:
            raise AssertionError("answered")
    try:
        lightstage.connect(os.path.join(folder, "nobody"))
    except lightstage.Lost as said:
        assert "no lightstaged answers at" in str(said)


def test_who_is_hung_up_on_is_told_why(folder):
    daemon = Daemon()
    stage = stage_of(daemon)
    stage.status()
    error = messages.Error(number=207, text="nothing was asked for 900 s")
    daemon.ours.sendall(wire.frame(wire.ERROR, 0, error.SerializeToString(), flags=1))
    daemon.ours.shutdown(socket.SHUT_RDWR)  # what is asked next cannot be sent
    refused(207, "nothing was asked", stage.status)


def test_halves_are_multiplied_as_the_core_does_it(folder):
    def bits(*values):
        return np.array(values, np.float16).view(np.uint16).tolist()

    def expanded(white, gain, ratio):
        return expand(np.array([white], np.float16), gain, np.array([ratio], np.float16))

    # core/promote_tile.h's examples; what is not finite; half a step, to even, and above; denormals
    for white, gain, ratio, expected in (
            (0.5, 1, 1.5, 0.75), (60000, 1, 2, 65504), (-60000, 1, 2, -65504), (np.inf, 1, 1, 0),
            (1, 1, np.nan, 0), (np.inf, 1, 0, 0), (1 + 2**-10, 1, 1.5, 1.5 + 2**-9),
            (1 + 3 * 2**-10, 1, 1.5, 1.5 + 2**-8), (2**-24, 0.5, 1, 0), (2**-24, 0.75, 1, 2**-24),
            (60000, 1e24, 1, 65504), (60000, 1e38, 1, 0)):
        got = expanded(white, gain, ratio)
        assert got.view(np.uint16).tolist() == bits(expected), (white, gain, ratio, got)


def test_a_png_and_a_pfm_hold_the_picture(folder):
    pixels = np.random.default_rng(1).uniform(0, 1, (5, 7, 3)).astype(np.float32)
    png, pfm = os.path.join(folder, "p.png"), os.path.join(folder, "p.pfm")
    assert lightstage.write_png(png, pixels, scale=1) == 1
    lightstage.write_pfm(pfm, pixels)
    with open(pfm, "rb") as file:
        head, data = file.read().split(b"-1.0\n", 1)
    assert head == b"PF\n7 5\n"
    assert np.array_equal(np.frombuffer(data, "<f4").reshape(5, 7, 3)[::-1], pixels)
    with open(png, "rb") as file:
        data = file.read()
    size = int.from_bytes(data[33:37], "big")  # of IDAT, the second chunk
    lines = np.frombuffer(zlib.decompress(data[41:41 + size]), np.uint8).reshape(5, 22)
    codes = lines[:, 1:].reshape(5, 7, 3) / 255
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    # half a code is at most 0.5 / 255 x the curve's inverse slope there, 2.4 / 1.055
    assert np.abs(linear - pixels).max() < 0.5 / 255 * 2.4 / 1.055 + 1e-6


def test_types_are_right(folder):
    harness.need("mypy")
    if os.environ.get("LS_TEST_BRIEF"):
        raise harness.Skip("types are those of the other build")
    settings = os.path.join(folder, "mypy.ini")
    harness.stage.write(settings, MYPY)
    done = subprocess.run(
        ["mypy", "--python-executable", sys.executable, "--config-file", settings,
         "--cache-dir", folder, "-p", "lightstage"], capture_output=True, text=True,
        env={**os.environ, "MYPYPATH": os.path.join(harness.BUILD, "clients", "python")})
    assert done.returncode == 0, done.stdout + done.stderr


if __name__ == "__main__":
    harness.main(globals())
