#!/usr/bin/python3 -B
"""lightstage-render, and the daemon without a rig that it starts for a folder."""
import json
import os
import signal
import struct
import subprocess
import sys

import numpy as np

import geometry
import harness
import pictures

RENDER = os.path.join(harness.BUILD, "clients", "lightstage-render")
# the daemon that a folder is served by
FOUND = {**os.environ, "PATH": os.path.join(harness.BUILD, "daemon") + ":" + os.environ["PATH"]}
FRAMES = (2, 4, 6)
EXAMPLE = os.path.join(harness.ROOT, "clients", "python", "examples", "relight.py")


def serving(folder):
    """A daemon that serves the takes of a folder and has no rig: (it, how its clients ask it)."""
    config, socket = os.path.join(folder, "serve.conf"), os.path.join(folder, "serve")
    harness.stage.write(config, f'storage = "{folder}/takes"; socket = "{socket}";')
    child = harness.stage.Process(os.path.join(folder, "serve.log"),
                                  os.path.join(harness.BUILD, "daemon", "lightstaged"), "--config",
                                  config)

    def ask(*words):
        return harness.stage.call(os.path.join(harness.BUILD, "clients", "lightstagectl"),
                                  "--socket", socket, *words)
    return child, ask


def test_a_daemon_without_a_rig_serves_takes_and_refuses_what_needs_one(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("served", harness.PLAN)
    options = ("--channel", "R", "--lights", "3", "--model", "sphere", "--layout", "rgb", "--output")
    rig.control("fetch", take, *options, rig.path("with"))
    assert not rig.stop()
    child, ask = serving(folder)
    ask("fetch", take, *options, rig.path("without"))
    assert np.array_equal(pictures.read(rig.path("with.0004.exr")),
                          pictures.read(rig.path("without.0004.exr")))
    ask("take", "verify", take)
    assert take in ask("take", "list")
    assert "not connected" in ask("status")
    subprocess.run([sys.executable, "-B", EXAMPLE, take, rig.path("example.png")], check=True, timeout=60,
                   env={**os.environ, "LIGHTSTAGED_SOCKET": rig.path("serve"),
                        "PYTHONPATH": os.path.join(harness.BUILD, "clients", "python")})
    bare = subprocess.run([sys.executable, "-B", EXAMPLE], capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": os.path.join(harness.BUILD, "clients", "python")})
    assert bare.returncode == 1 and bare.stderr.endswith("Usage: relight.py TAKE PICTURE.png\n"), bare
    plan = rig.path("plan.conf")
    for words in (("blank",), ("preflight", "--plan", plan), ("take", "start", "--name", "x", "--plan", plan),
                  ("take", "resume", take)):
        harness.refuses("its configuration names no rig (108", lambda w=words: ask(*w))
    wrong = child.stop()
    assert not wrong, wrong


def command(take, *words):
    return [RENDER, take, *words]


def rendered(*words):
    """What it says; Failed with its last words otherwise."""
    done = subprocess.run(command(*words), env=FOUND, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    if done.returncode:
        raise harness.Failed(done.stderr.strip(), done.returncode)
    return json.loads(done.stdout) if "--json" in words else done.stdout


def sky(rig, number, seed):
    random = np.random.default_rng(seed)
    return geometry.hdr(rig.path(f"sky.{number:04d}.hdr"), random.uniform(0.1, 1.2, (16, 32, 3)))


def told(**counts):
    return {"frames": 3, "made": 0, "kept": 0, **counts}


def counts(said):
    return {key: said[key] for key in ("frames", "made", "kept")}


def sequence(rig, place, *words):
    """The words of three frames below a folder."""
    os.makedirs(rig.path(place), exist_ok=True)
    return (rig.path("sky.%04d.hdr"), "--frames", "2-6x2", "--rotate", "0,30", "--output",
            rig.path(os.path.join(place, "relit.%04d.exr")), "--json", *words)


def files(rig, place):
    found = {}
    for name in sorted(os.listdir(rig.path(place))):
        with open(rig.path(os.path.join(place, name)), "rb") as file:
            found[name] = file.read()
    return found


def test_frames_are_those_of_relight_by_server_and_by_folder(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("rendered", harness.PLAN)
    maps = {number: sky(rig, number, number) for number in FRAMES}
    server = ("--socket", rig.path("socket"))
    said = rendered(take, *sequence(rig, "served", "--jobs", "2"), *server)
    assert counts(said) == told(made=3), said
    for turn, number in zip((0, 15, 30), FRAMES):
        one = rig.path("one.exr")
        rig.control("relight", take, maps[number], "--rotate", str(turn), "--output", one)
        frame = rig.path(f"served/relit.{number:04d}.exr")
        assert np.array_equal(pictures.read(one), pictures.read(frame)), number
        about = {name: value for name, (_, value) in pictures.attributes(frame).items()}
        assert about["lightstage/frame"] == struct.pack("<i", number), about
        assert about["lightstage/rotation"] == struct.pack("<f", turn), about
        assert about["lightstage/environment"] == f"sky.{number:04d}.hdr".encode(), about
        assert about["lightstage/take"] == take.encode() and "chromaticities" in about, about
    before = files(rig, "served")
    assert sorted(before) == [f"relit.{n:04d}.exr" for n in FRAMES], "a part was left"

    said = rendered(take, *sequence(rig, "served"), *server)
    assert counts(said) == told(kept=3), "whole frames are kept"
    os.truncate(rig.path("served/relit.0004.exr"), len(before["relit.0004.exr"]) - 100)
    said = rendered(take, *sequence(rig, "served"), *server)
    assert counts(said) == told(made=1, kept=2), "half a frame is none"
    assert files(rig, "served") == before
    sky(rig, 4, 44)
    said = rendered(take, *sequence(rig, "served"), *server)
    assert counts(said) == told(made=1, kept=2), "another light, another frame"
    assert files(rig, "served")["relit.0004.exr"] != before["relit.0004.exr"]
    sky(rig, 4, 4)
    said = rendered(take, *sequence(rig, "served", "--again"), *server)
    assert counts(said) == told(made=3), said
    assert files(rig, "served") == before

    assert not rig.stop()
    said = rendered(rig.path(os.path.join("takes", take)), *sequence(rig, "alone"))
    assert counts(said) == told(made=3), said
    assert files(rig, "alone") == before, "a folder needs no daemon, and gives the same files"


def children(pid):
    path = f"/proc/{pid}/task/{pid}/children"
    return harness.stage.read(path).split() if os.path.exists(path) else []


def gone(pid):
    try:
        return harness.stage.read(f"/proc/{pid}/stat").rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_a_killed_render_leaves_no_half_frame_and_goes_on(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("killed", harness.PLAN)
    assert not rig.stop()
    sky(rig, 1, 1)
    # 80 frames, 16 at a time: it is killed after the first of them
    words = (rig.path(os.path.join("takes", take)), rig.path("sky.0001.hdr"), "--frames", "1-80",
             "--rotate", "0,360", "--jobs", "1", "--output", rig.path("out/relit.%04d.exr"))
    os.mkdir(rig.path("out"))
    child = subprocess.Popen(command(*words, "--quiet"), env=FOUND,
                             preexec_fn=harness.stage.die_with_parent)
    harness.wait_for("a first frame", lambda: os.path.exists(rig.path("out/relit.0001.exr")))
    daemon, = children(child.pid)
    child.send_signal(signal.SIGKILL)
    child.wait()
    harness.wait_for("its daemon ends with it", lambda: gone(daemon))
    there = [n for n in os.listdir(rig.path("out")) if n.endswith(".exr")]
    assert 0 < len(there) < 80, "killed too late"
    for name in there:
        assert np.isfinite(pictures.read(rig.path(f"out/{name}"))).all(), name
    said = rendered(*words, "--json")
    assert (said["made"], said["kept"]) == (80 - len(there), len(there)), said
    assert len(os.listdir(rig.path("out"))) == 80, "what was left behind is used or removed"


def test_wrong_words_and_files_are_refused_with_what_to_do(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("refused", harness.PLAN)
    for number in (1, 2):
        sky(rig, number, number)
    where = ("--socket", rig.path("socket"))
    os.makedirs(rig.path("renamed"))
    os.link(rig.path(os.path.join("takes", take, "take.json")), rig.path("renamed/take.json"))
    good = (rig.path("sky.0001.hdr"), "--output", rig.path("one.exr"), *where)
    for sentence, words in (
            ("--frames FIRST-LAST", (take, rig.path("sky.%04d.hdr"), *good[1:])),
            ("expected a number in the name", (take, *good, "--frames", "1-2")),
            ("--frames 9-1: expected", (take, *good, "--frames", "9-1")),
            ("--rotate 5: expected degrees FROM,TO", (take, *good, "--rotate", "5")),
            ("--jobs 0: expected 1 to 16", (take, *good, "--jobs", "0")),
            ("--output FOLDER/NAME", (take, good[0])),
            ("lit with, which is kept", (take, good[0], "--output", good[0], *where)),
            ("lit with, which is kept", (take, rig.path("sky.0002.hdr"), good[0], "--output",
                                         rig.path("sky.%04d.hdr"), *where)),
            ("away: no such folder", (rig.path("away"), *good[:3])),
            ("awry: no such folder, nor the name of a take, as 2026", ("awry", *good)),
            ("no take.json in it", (rig.path("takes"), *good[:3])),
            ("has the take's name, as 2026", (rig.path("renamed"), *good[:3])),
            ("absent.hdr", (take, rig.path("absent.hdr"), *good[1:])),
            ("No such file", (take, good[0], "--output", rig.path("no/one.exr"), *where)),
            ("20000101T000000Z-x-000000", ("20000101T000000Z-x-000000", *good)),
            ("no.sock", (take, *good[:3], "--socket", rig.path("no.sock")))):
        harness.refuses(sentence, lambda w=words: rendered(*w))
    assert not os.path.exists(rig.path("one.exr"))
    with open(rig.path("one.exr.part"), "wb") as held:
        subprocess.run(["flock", "-n", str(held.fileno())], pass_fds=[held.fileno()], check=True)
        harness.refuses("another program is making it", lambda: rendered(take, *good))
    assert "1 made" in rendered(take, *good)


harness.main(globals())
