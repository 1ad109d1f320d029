#!/usr/bin/python3 -B
"""The Python package on a simulated stage: what lightstagectl gets, bit for bit."""
import json
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np

import harness
import lightstage
import pictures
import takes
from harness import stage as rigs

EXAMPLE = os.path.join(harness.ROOT, "clients", "python", "examples", "relight.py")


def photographed(folder):
    """A take that the package starts and follows: (rig, connected stage, id)."""
    rig = harness.twelve(folder).start()
    stage = lightstage.connect(rig.path("socket"), timeout=60)
    assert stage.preflight(harness.PLAN).shots >= 3 * 18  # of six spheres and twelve lights
    begun = stage.start("vase", harness.PLAN)
    assert stage.start("vase", harness.PLAN, begun.token).token == begun.token
    stored = [status.progress.conditions_stored for status in stage.progress(begun.token)]
    assert stored == sorted(stored) and len(set(stored)) > 2, stored
    take = stage.follow(begun)
    assert take.state == lightstage.messages.COMPLETE, take
    return rig, stage, take.id


def fetched(rig, take, *how):
    """[n][height][width][components] of lightstagectl."""
    rig.control("fetch", take, *how, "--output", rig.path("f"), "--json")
    names = sorted(n for n in os.listdir(rig.folder) if n.startswith("f.") and n.endswith(".exr"))
    try:
        return np.stack([pictures.read(rig.path(n)) for n in names]).astype(np.float32)
    finally:
        for name in names:
            os.remove(rig.path(name))


def read(path):
    with open(path, "rb") as file:
        return file.read()


def pictures_are_those_of_lightstagectl(rig, stage, take):
    crop = (10, 21, 70, 65)
    area = ",".join(map(str, crop))
    for ours, theirs in (
            ({}, ("--channel", "W")),
            ({"dtype": "float16", "quantity": "estimate"}, ("--channel", "W", "--estimate", "--half")),
            ({"lights": [5, 3], "region": crop}, ("--channel", "W", "--lights", "3,5", "--region", area)),
            ({"channel": "R", "model": "sphere", "layout": "rgb", "dtype": "float16"},
             ("--channel", "R", "--model", "sphere", "--layout", "rgb", "--half")),
            ({"channel": "R", "model": "sphere", "layout": "rgb", "region": crop, "lights": [1]},
             ("--channel", "R", "--model", "sphere", "--layout", "rgb", "--region", area, "--lights", "1")),
            ({"channel": "W", "layout": "mono"}, ("--channel", "W", "--layout", "mono")),
            ({"channel": "R", "model": "sphere", "layout": "mono", "region": crop, "level": 1},
             ("--channel", "R", "--model", "sphere", "--layout", "mono", "--region", area, "--level", "1")),
            ({"channel": "B", "full_sphere": True}, ("--channel", "B", "--full-sphere"))):
        asked = {"channel": "W", **ours}
        field = stage.fetch(take, **asked)
        order = np.argsort(field.lights)
        assert field.pixels.any() and field.pixels.shape[-1] == (3 if "rgb" in asked.values() else 1)
        assert np.array_equal(field.pixels[order].astype(np.float32), fetched(rig, take, *theirs)), ours
        one_by_one = list(stage.pictures(take, **asked))
        assert [p.light for p in one_by_one] == field.lights
        assert np.array_equal(np.stack([p.pixels for p in one_by_one]), field.pixels)
    known = stage.fetch(take, "W", lights=[0], variance=True, validity=True).pictures[0]
    assert known.variance.shape == known.validity.shape == (128, 128) and known.variance.min() > 0
    assert set(np.unique(known.validity)) <= {0, 1, 2, 3}


def tiles_come_once_and_again_only_if_they_have_changed(rig, stage, take):
    crop = (70, 10, 50, 100)  # the right half of the tiles
    for asked in ({"channel": "W", "dtype": "float16", "quantity": "estimate"},
                  {"channel": "W", "region": crop},
                  {"channel": "R", "model": "sphere", "layout": "rgb", "dtype": "float16", "region": crop},
                  {"channel": "R", "model": "sphere", "layout": "rgb", "region": crop, "level": 1},
                  {"channel": "R", "model": "sphere", "layout": "mono", "dtype": "float16", "region": crop}):
        expected = stage.fetch(take, **asked)
        tiles = lightstage.Tiles()
        stage.fetch_tiles(tiles, take, **asked)
        assert tiles.lights == expected.lights and tiles.received == tiles.hashes.size
        for k, pixels in enumerate(expected.pixels):
            assert np.array_equal(tiles.picture(k), pixels), asked
        whole = tiles.pixels.copy()
        stage.fetch_tiles(tiles, take, **asked)
        assert tiles.received == 0 and np.array_equal(tiles.pixels, whole), asked
        # two that are gone, and what comes in their place
        tiles.hashes.reshape(-1)[[1, -1]] = 0
        tiles.pixels.reshape(tiles.hashes.size, -1)[[1, -1]] = 7
        stage.fetch_tiles(tiles, take, **asked)
        assert tiles.received == 2 and np.array_equal(tiles.pixels, whole), asked
        # from the fifth on
        tiles.hashes.reshape(-1)[5:], tiles.pixels[:] = 0, 7
        stage.fetch_tiles(tiles, take, resume=True, **asked)
        ours, theirs = (a.reshape(tiles.hashes.size, -1) for a in (tiles.pixels, whole))
        assert np.array_equal(ours[5:], theirs[5:]) and np.all(ours[:5] == 7), asked
        assert tiles.missing == tiles.hashes.size and tiles.lights == expected.lights
        # in the daemon's memory
        for shared, pixels in zip(stage.shared(take, **asked), expected.pixels, strict=True):
            assert np.array_equal(shared.picture(), pixels), asked
            assert not shared.tiles.flags.writeable
    open_fds = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        list(stage.shared(take, "W", dtype="float16", quantity="estimate", credit_bytes=1))
    assert len(os.listdir("/proc/self/fd")) == open_fds, "descriptors are left open"


def each_light_comes_under_every_spectrum(stage, take):
    how = {"model": "sphere", "layout": "rgb", "lights": [7, 2], "region": (3, 7, 111, 90)}
    one_by_one = [stage.fetch(take, c, **how) for c in "RWB"]
    field = stage.fetch(take, spectra=["R", "W", "B"], **how)
    assert field.lights == [7, 7, 7, 2, 2, 2] and field.pixels.shape[0] == 6
    for k, picture in enumerate(field.pictures):
        alone = one_by_one[k % 3].pictures[k // 3]
        assert picture.number == k % 3 and picture.spectrum == alone.spectrum
        assert np.array_equal(picture.pixels, alone.pixels)
    tiles = lightstage.Tiles()
    stage.fetch_tiles(tiles, take, spectra=["R", "W", "B"], **how)
    assert tiles.lights == field.lights
    shared = list(stage.shared(take, spectra=["R", "W", "B"], **how))
    assert [(s.light, s.number) for s in shared] == [(p.light, p.number) for p in field.pictures]
    for k, pixels in enumerate(field.pixels):
        assert np.array_equal(tiles.picture(k), pixels) and np.array_equal(shared[k].picture(), pixels)


def what_is_under_max_error_does_not_come(rig, stage, take):
    for asked, theirs in (
            ({"channel": "W", "dtype": "float16", "quantity": "estimate"},
             ("--channel", "W", "--half", "--estimate")),
            ({"channel": "R", "model": "sphere", "layout": "rgb", "dtype": "float16"},
             ("--channel", "R", "--model", "sphere", "--layout", "rgb", "--half")),
            ({"channel": "R", "model": "sphere", "layout": "rgb", "region": (70, 10, 50, 100)},
             ("--channel", "R", "--model", "sphere", "--layout", "rgb", "--region", "70,10,50,100"))):
        exact, some = lightstage.Tiles(), lightstage.Tiles()
        stage.fetch_tiles(exact, take, **asked)
        bright = np.abs(exact.pixels.astype(np.float32)).max(axis=(3, 4, 5))
        bound = float(np.median(bright))
        for _ in range(2):  # the second time nothing is new
            stage.fetch_tiles(some, take, max_error=bound, **asked)
            assert np.array_equal(some.left_out, bright <= bound) and some.left_out.any(), asked
            assert bright[some.left_out].max() <= some.error_bound <= bound
            assert np.abs(some.pixels.astype(np.float32) - exact.pixels).max() <= some.error_bound
            assert np.array_equal(some.hashes, np.where(some.left_out, 0, exact.hashes))
            assert some.missing == some.hashes.size
        assert some.received == 0 and some.lights == exact.lights
        written = fetched(rig, take, *theirs, "--max-error", repr(bound))
        for place, k in enumerate(np.argsort(some.lights)):
            assert np.array_equal(written[place], some.picture(k).astype(np.float32)), asked
        for k, shared in enumerate(stage.shared(take, max_error=bound, **asked)):
            assert np.abs(shared.picture().astype(np.float32) - exact.picture(k)).max() <= bound
        stage.fetch_tiles(some, take, **asked)  # and all of it after all
        assert np.array_equal(some.pixels, exact.pixels) and not some.left_out.any()
        assert some.received == (bright <= bound).sum() and some.error_bound == 0


def a_factored_fetch_expands_to_what_the_daemon_sends_as_halves(rig, stage, take):
    how = {"region": (3, 7, 111, 90), "model": "sphere"}
    factored = stage.fetch_factored(take, ["R", "B"], lights=[2, 0, 7], **how)
    assert factored.lights == [2, 0, 7] and list(factored.ratios) == ["R", "B"]
    for spectrum in ("R", "B"):
        field = stage.fetch(take, spectrum, lights=[2, 0, 7], layout="rgb", dtype="float16", **how)
        for k, pixels in enumerate(field.pixels):
            assert pixels.max() > 0
            assert np.array_equal(factored.picture(k, spectrum).view("u2"), pixels.view("u2"))
    one = stage.fetch_factored(take, ["R"], lights=[0])  # number 0 is a ratio, and a light
    assert one.lights == [0] and list(one.ratios) == ["R"]


def looked_at(ring):
    """A frame of a take that runs: there for a moment each."""
    limit = time.monotonic() + 30
    while (frame := ring.newest()) is None:
        assert time.monotonic() < limit, "no frame could be read"
    return frame


def test_pictures_and_frames_are_looked_at_while_their_take_runs(folder):
    rig = harness.twelve(folder).start()
    seen, frames, ring = {}, {}, None
    with lightstage.connect(rig.path("socket"), timeout=60) as stage:
        events = stage.events(published=True, progress=True)
        first = next(events)  # where things stand
        assert first.progress.state == lightstage.messages.NONE, first
        refused(200, stage.ring)
        begun = stage.start("vase", takes.LONG)
        for event in events:
            for picture in event.published:
                if picture.single_light and len(seen) < 3:
                    seen[picture.channel, picture.light] = stage.fetch(
                        event.take, picture.channel, lights=[picture.light], quantity="estimate").pixels
                    ring = ring or stage.ring()
                    frame = looked_at(ring)
                    frames[frame.number] = frame.payload.tobytes()
            if event.HasField("progress") and len(seen) == 3:
                break
        assert event.progress.state == lightstage.messages.RUNNING, event  # three of 48 are there
        events.close()
        take = stage.follow(begun)
        assert take.state == lightstage.messages.COMPLETE, take
        assert (ring.report.take, ring.report.width, ring.report.height) == (take.id, 128, 128)
        raw = os.path.join(takes.folder(rig, take.id), "cam0", "raw")
        kept = {read(os.path.join(raw, name)) for name in os.listdir(raw)}
        pixels = {payload[:2 * 128 * 128] for payload in frames.values()}
        assert kept.issuperset(pixels), (list(frames), len(kept))
        assert len(frames) > 1 and min(frames) > 0, list(frames)
        ring.newest()  # the memory stays
        refused(200, stage.ring)
        for (channel, light), pixels in seen.items():
            whole = stage.fetch(take.id, channel, lights=[light], quantity="estimate").pixels
            assert np.array_equal(pixels, whole), (channel, light)


LISTEN = """listen = { port = 0; certificate = "pki/server.pem"; key = "pki/server.key";
                            authority = "pki/authority.pem"; operators = ["operator"];
                            readers = ["reader"]; };"""


def over_tls(rig, name, ours="pki", theirs="pki"):
    """A connection with our certificate of one authority, to a daemon whom another should vouch for."""
    return lightstage.connect(
        f"tls://{rig.daemon.ready['tls']}", certificate=rig.path(f"{ours}/{name}.pem"), timeout=60,
        key=rig.path(f"{ours}/{name}.key"), authority=rig.path(f"{theirs}/authority.pem"))


class Interrupted(Exception):
    pass


def interrupt(*_):
    raise Interrupted


def interrupted_fetches(stage, take, expected, times=8):
    """At random moments; what is fetched after each is right."""
    seed = int(os.environ.get("LS_TEST_SEED", time.time()))
    dice, hit, took = random.Random(seed), 0, 0
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        while hit < times:
            try:
                signal.setitimer(signal.ITIMER_REAL, 1e-5 + dice.uniform(0, took))
                stage.fetch(take, "W")
                signal.setitimer(signal.ITIMER_REAL, 0)
            except Interrupted:
                hit += 1
            began = time.monotonic()
            assert np.array_equal(stage.fetch(take, "W").pixels, expected), f"seed {seed}"
            took = time.monotonic() - began
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    print(f"# seed {seed}: interrupted {hit} times")


def test_over_tls_come_the_same_bits_and_nobody_else_is_let_in(folder):
    rig = harness.twelve(folder, daemon_extra=LISTEN)
    for name in ("pki", "others"):
        rig.control("pki", "init", rig.path(name))
    take = rig.start().start_take("vase", harness.PLAN)
    local, far = lightstage.connect(rig.path("socket")), over_tls(rig, "reader")
    for asked in ({"channel": "W"}, {"channel": "W", "region": (10, 21, 70, 65), "lights": [4, 1]},
                  {"channel": "R", "model": "sphere", "layout": "rgb", "dtype": "float16"}):
        expected, tiles = local.fetch(take, **asked).pixels, lightstage.Tiles()
        assert np.array_equal(far.fetch(take, **asked).pixels, expected), asked
        far.fetch_tiles(tiles, take, **asked)
        assert np.array_equal(np.stack([tiles.picture(k) for k in range(len(expected))]), expected)
    many = np.ones((20, 12), np.float32)  # weights and pictures, larger than a record
    assert np.array_equal(far.relight(take, {"W": many, "R": many}).pixels,
                          local.relight(take, {"W": many, "R": many}).pixels)
    refused(110, lambda: far.start("mine", harness.PLAN))
    refused(108, lambda: list(far.shared(take, "W")))
    interrupted_fetches(far, take, local.fetch(take, "W").pixels)
    interrupted_fetches(local, take, local.fetch(take, "W").pixels)
    far.close()
    operator = over_tls(rig, "operator")
    operator.preflight(harness.PLAN)
    refused(108, operator.ring)
    rig.control("pki", "add", rig.path("pki"), "stranger")
    refused(110, lambda: over_tls(rig, "stranger"))  # of the authority, and in no list
    for wrong, words in (({"ours": "others"}, "lost.*alert unknown ca"),
                         ({"theirs": "others"}, "no lightstaged answers at tls://.*verify failed")):
        try:
            over_tls(rig, "operator", **wrong)
        except lightstage.Lost as said:
            takes.says(str(said), words)
        else:
            raise AssertionError("let in")
    local.close()


def refused(number, act):
    try:
        act()
    except lightstage.Refused as wrong:
        assert wrong.number == number and wrong.sentence, wrong
    else:
        raise AssertionError(f"not refused with {number}")


def relit_pictures_are_those_of_lightstagectl(rig, stage, take):
    dice = np.random.default_rng(1)
    weights = {c: dice.uniform(0, 1, 12).astype(np.float32) for c in "WR"}
    rigs.write(rig.path("weights.json"), json.dumps({c: w.tolist() for c, w in weights.items()}))
    rig.control("relight", take, "--weights", rig.path("weights.json"), "--raw", "--output",
                rig.path("relit.exr"))
    expected = pictures.read(rig.path("relit.exr"))
    got = stage.relight(take, weights)
    assert np.array_equal(got.pixels, expected)
    assert got.report.lights_used == 12 and got.report.calibrated
    out = np.zeros((2, 128, 128, 3), np.float32)
    two = stage.relight(take, {c: np.stack([w, 2 * w]) for c, w in weights.items()}, out=out)
    assert two.pixels is out and np.array_equal(out[0], expected)
    assert np.array_equal(out[1], 2 * out[0])  # twice is exact
    targets = stage.relight(take, {c: np.stack([w] * 3) for c, w in weights.items()}, mode="per_target")
    # the same light; sums of other shape are rounded in another order
    assert np.allclose(targets.pixels, expected, rtol=1e-5, atol=1e-6)
    # the example
    environment = {**os.environ, "LIGHTSTAGED_SOCKET": rig.path("socket"),
                   "PYTHONPATH": os.path.join(harness.BUILD, "clients", "python")}
    subprocess.run([sys.executable, "-B", EXAMPLE, take, rig.path("relit.png")], check=True,
                   env=environment, timeout=60)
    with open(rig.path("relit.png"), "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n" and len(file.read()) > 1000
    code = [line for line in rigs.read(EXAMPLE).splitlines()[2:] if line.strip()]
    assert len(code) <= 10, f"the example has grown to {len(code)} lines"


def test_what_is_fetched_and_relit_is_that_of_lightstagectl_to_the_bit(folder):
    with_take = photographed(folder)
    pictures_are_those_of_lightstagectl(*with_take)
    tiles_come_once_and_again_only_if_they_have_changed(*with_take)
    what_is_under_max_error_does_not_come(*with_take)
    each_light_comes_under_every_spectrum(*with_take[1:])
    a_factored_fetch_expands_to_what_the_daemon_sends_as_halves(*with_take)
    relit_pictures_are_those_of_lightstagectl(*with_take)
    with_take[1].close()


def test_a_take_is_looked_at_described_and_refused_in_python(folder):
    rig, stage, take = photographed(folder)
    assert [t.id for t in stage.takes()] == [take]
    assert stage.show(take)["plan"]["conditions"] and stage.summary(take).n_lights == 12
    checked = stage.verify(take)
    assert checked.conditions_checked > 18 and not checked.conditions_damaged, checked
    assert stage.slate(take, scene="7", take_number=2).scene == "7"
    slate = stage.slate(take, notes="chipped")
    assert (slate.scene, slate.take, slate.notes) == ("7", 2, "chipped")
    assert stage.status().lights.connected and stage.metrics().takes_complete == 1
    said = stage.rig()
    assert said.positions_m.shape == (12, 3) and [c.name for c in said.channels][0] == "W"
    refused(202, lambda: stage.show("20200101T000000Z-no-abcdef"))
    refused(200, stage.abort)
    refused(107, lambda: stage.slate(take, timecode="noon"))
    stage.blank()
    begun = stage.start("again", takes.LONG)
    follow = stage.progress(begun.token)
    next(s for s in follow if s.state == lightstage.messages.RUNNING)
    follow.close()
    stage.abort()
    assert stage.follow(begun).state == lightstage.messages.ABORTED
    looks = stage.preview(exposure_us=5000)
    look = next(looks)
    assert look.report.width * look.report.bin == 128 and look.pixels.shape == (64, 64, 3)
    looks.close()
    assert stage.status().lights.connected
    stage.close()


if __name__ == "__main__":
    harness.main(globals())
