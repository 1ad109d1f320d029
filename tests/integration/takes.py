"""Verbs about takes: start and follow them, read what they left, judge whether frames are theirs."""
import array
import json
import os
import re
import signal
import subprocess
import threading

import harness
from harness import stage

FULL_SCALE_DN = 4095
GRID, RECORD_BYTES = 16, 28  # of a stamp: sim/stamp.h
# Warm-up spends five pulses; then come 24 darks, then six spheres and twelve lights, three
# exposures each: a pulse's number since the start of the simulator is
WARM_UP, DARKS, LIGHTS = 5, 24, 54
FIRST_DARK, FIRST_LIGHT, LAST = WARM_UP + 1, WARM_UP + DARKS + 1, WARM_UP + DARKS + LIGHTS
LIT_SHARE = 0.9  # of an exposure; what may be missing is an edge too early to be told from jitter
# More lights, no spheres: time enough to interfere.
LONG = """subject = "still";
exposures_us = [500, 2500, 12500];
darks = 8;
keep_raw = true;
reference = { every = 0; };
conditions = ( { kind = "each"; channels = ["W", "R", "G", "B"]; order = "given"; } );
"""
KEEP_RAW = harness.PLAN + "keep_raw = true;\n"


# ---- crc32c, as the journal writes it ----

def _table():
    out = []
    for n in range(256):
        for _ in range(8):
            n = n >> 1 ^ (0x82f63b78 if n & 1 else 0)
        out.append(n)
    return out


_TABLE = _table()


def crc32c(data):
    crc = 0xffffffff
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xff]
    return crc ^ 0xffffffff


# ---- the client ----

def ctl(rig, *arguments):
    return [rig.program("clients/lightstagectl"), "--socket", rig.path("socket"), *arguments]


def ask(rig, *arguments, seconds=120):
    """Run the client to its end: (exit code, standard output, standard error)."""
    done = subprocess.run(ctl(rig, *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          stdin=subprocess.DEVNULL, text=True, timeout=seconds)
    return done.returncode, done.stdout, done.stderr


def plan_file(rig, text):
    """Put in its place whole: a client begun before may be about to read it."""
    path = rig.path("plan.conf")
    stage.write(path + ".new", text)
    os.replace(path + ".new", path)
    return path


def photograph(rig, plan=KEEP_RAW, name="take", token=None):
    """A take to its end, however that is: (exit code, status object or None, standard error)."""
    extra = ("--token", token) if token else ()
    code, out, err = ask(rig, "take", "start", "--name", name, "--plan", plan_file(rig, plan),
                         "--json", *extra)
    return code, json.loads(out) if out.strip() else None, err


def resume(rig, take):
    code, out, err = ask(rig, "take", "resume", take, "--json")
    return code, json.loads(out) if out.strip() else None, err


def resume_freed(rig, take):
    """Resume after the daemon was killed: a camera lets go of a dead host by its own heartbeat."""
    outcome = []

    def is_free():
        outcome[:] = [resume(rig, take)]
        busy = "another program controls it" in outcome[0][2]
        assert not busy or (outcome[0][0] == 5 and "try again" in outcome[0][2]), outcome
        return not busy
    harness.wait_for("the camera is free", is_free)
    return outcome[0]


def begin(rig, plan=KEEP_RAW, name="take", token="begun", wait=False):
    """A client that starts a take, as a process of its own; with wait=False it has come back."""
    options = () if wait else ("--no-wait",)
    client = subprocess.Popen(
        ctl(rig, "take", "start", "--name", name, "--token", token, "--plan",
            plan_file(rig, plan), "--json", *options),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True,
        preexec_fn=stage.die_with_parent)
    if not wait:
        out, err = client.communicate(timeout=60)
        assert client.returncode == 0, err
        return json.loads(out)["id"]
    return client


def ended(rig, token="begun"):
    """Follow the take of a token to its end: the same command again never fires twice."""
    code, status, err = photograph(rig, token=token)
    assert status, err
    return code, status


class Events:
    """lightstagectl events, line by line."""

    def __init__(self, rig, *options):
        self.process = subprocess.Popen(ctl(rig, "events", "--json", *options),
                                        stdout=subprocess.PIPE, text=True,
                                        preexec_fn=stage.die_with_parent)

    def next(self, kind):
        """The next event of a kind, within a minute; what came before it is gone."""
        limit = threading.Timer(60, self.process.kill)
        limit.start()
        try:
            for line in self.process.stdout:
                event = json.loads(line)
                if event["event"] == kind:
                    return event
        finally:
            limit.cancel()
        raise AssertionError(f"lightstagectl events told of no {kind}")

    def stop(self):
        self.process.terminate()
        self.process.wait(10)
        self.process.stdout.close()


def alarm(rig):
    """The first alarm that is on, as it is told to who comes late."""
    events = Events(rig, "--alarms")
    event = events.next("alarm")
    events.stop()
    assert event["active"], event
    return event


def fire(rig, number):
    """Wait until the simulator has exposed so many frames since its start."""
    harness.wait_for(f"{number} pulses fired", lambda: exposures(rig) >= number)


def exposures(rig):
    path = rig.path("shown.jsonl")
    return stage.read(path).count("\n") if os.path.exists(path) else 0


# ---- what a take left ----

def folder(rig, take):
    return rig.path(os.path.join("takes", take))


def files(rig, take):
    """Every published picture's bytes by its name."""
    out = {}
    for record in published(rig, take):
        with open(os.path.join(folder(rig, take), record["file"]), "rb") as file:
            out[record["file"]] = file.read()
    return out


def records(rig, take, kind):
    """The journal's whole records of a kind, checked; a killed writer may leave half a last one."""
    with open(os.path.join(folder(rig, take), "journal"), "rb") as file:
        lines = file.read().split(b"\n")[:-1]
    whole = [l[9:] for l in lines if l[:8] == b"%08x" % crc32c(l[9:])]
    assert len(whole) >= len(lines) - 1, "the journal is damaged before its end"
    return [r for r in map(json.loads, whole) if r["k"] == kind]


def published(rig, take):
    return records(rig, take, "published")


def alarms(rig, take):
    return [r["text"] for r in records(rig, take, "alarm")]


def document(rig, take):
    return rig.ask("take", "show", take)["take"]


# ---- judging ----

def stamp(path):
    """What was truly in force, out of a raw frame's pixels; None if it cannot be read."""
    with open(path, "rb") as file:
        dn = array.array("H", file.read())
    width = int(len(dn) ** 0.5)
    block = width // GRID
    margin = block // 4
    side = block - 2 * margin
    limit = 0.45 * FULL_SCALE_DN * side * side  # between a dark block's 0.2 and a light one's 0.7
    found = bytearray(GRID * GRID // 8)
    for bit in range(GRID * GRID):
        x, y = bit % GRID * block + margin, bit // GRID * block + margin
        lit = sum(sum(dn[(y + j) * width + x:(y + j) * width + x + side]) for j in range(side))
        found[bit // 8] |= (lit > limit) << bit % 8

    def at(offset, size):
        return int.from_bytes(found[offset:offset + size], "little")
    if at(RECORD_BYTES, 4) != crc32c(found[:RECORD_BYTES]):
        return None
    return {"kind": ("dark", "one", "sphere", "segment")[at(0, 2)], "light": at(4, 2),
            "channel": at(6, 1), "camera": at(7, 1), "exposure_us": at(16, 4) / 100,
            "lit_us": at(20, 4) / 100}


def mislabeled_pixels(rig, take, channels="WRAGCBVH", only=None):
    """Shots whose kept pixels show something else than the take says they do; only: pictures
    ("cam0/W-0003") whose shots are looked at, of a take that is not complete."""
    plan = document(rig, take)["plan"]["conditions"]
    latest = {t["shot"]: t for t in records(rig, take, "ticket") if t["status"] == "ok"}
    wrong = []
    for shot, ticket in latest.items():
        name = f"cam{ticket['camera']}/{plan[ticket['condition']]['id']}"
        if only is not None and name not in only:
            continue
        seen = stamp(os.path.join(folder(rig, take), f"cam{ticket['camera']}", "raw",
                                  f"{shot}-{ticket['attempt']}.raw"))
        asked = plan[ticket["condition"]]
        light = int(asked["id"].split("-")[1]) if asked["kind"] == "one" else None
        # a tenth of a permille and 1 us: the controller's clock drifts, and counts whole us
        near = 1 + 1e-4 * ticket["exposure_used_us"]
        right = (seen and seen["kind"] == asked["kind"] and seen["camera"] == ticket["camera"] and
                 (asked["kind"] == "dark" or channels[seen["channel"]] == asked["channel"]) and
                 (light is None or seen["light"] == light) and
                 abs(seen["exposure_us"] - ticket["exposure_used_us"]) < near and
                 (asked["kind"] == "dark" or seen["lit_us"] > LIT_SHARE * seen["exposure_us"]))
        if not right:
            wrong.append((shot, asked["id"], seen))
    return wrong


def is_good(rig, take, pixels=True):
    """The take is whole, its files are sound, and every frame is the frame it says it is."""
    code, out, err = ask(rig, "take", "verify", take)
    assert code == 0, out + err
    judged = rig.judge(take)
    assert judged["shots_lost"] == 0, judged
    assert judged["frames_mislabeled"] == 0, judged
    if pixels:
        wrong = mislabeled_pixels(rig, take)
        assert not wrong, f"{len(wrong)} frames show something else, first {wrong[0]}"
    states = {t["id"]: t["state"] for t in rig.takes()}
    assert states[take] == "complete", states
    return judged


def lights_status(rig):
    return rig.ask("status")["lights"]


def call_quietly(*command):
    """The exit code of a program whose words do not matter."""
    return subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                          stdin=subprocess.DEVNULL).returncode


def interrupt(client):
    client.send_signal(signal.SIGINT)


def says(text, *words):
    for word in words:
        assert re.search(word, text), f"\"{text}\" does not say \"{word}\""
