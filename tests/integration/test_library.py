#!/usr/bin/python3 -B
"""liblightstage and the real daemon: takes and pictures at its socket and by TLS."""
import json
import os
import subprocess

import numpy as np

import harness
import pictures
import takes

LISTEN = """listen = { port = 0; certificate = "pki/server.pem"; key = "pki/server.key";
  authority = "pki/authority.pem"; operators = ["operator"]; readers = ["reader"]; };"""
FRAMES = 3  # that the client looks at
PICTURES = 21  # of harness.PLAN with twelve lights: three darks, six spheres, twelve lights
CLIENT = os.path.join(harness.BUILD, "tests", "integration", "library_client")


def by_library(rig, what, who=None):
    """(exit code, pixels, standard error) of the test's client; who: by TLS, as that."""
    where = (rig.path("socket"),) if who is None else (
        "tls://" + rig.daemon.ready["tls"], rig.path(f"pki/{who}.pem"), rig.path(f"pki/{who}.key"),
        rig.path("pki/authority.pem"))
    done = subprocess.run([CLIENT, what, *where], capture_output=True, timeout=60)
    return done.returncode, np.frombuffer(done.stdout, np.float32), done.stderr.decode()


def fetched_by_control(rig, take):
    rig.control("fetch", take, "--channel", "R", "--lights", "0,7", "--model", "sphere",
                "--layout", "rgb", "--output", rig.path("control"))
    return [pictures.read(rig.path(f"control.{light:04d}.exr")) for light in (1, 8)]


def check_frames(rig, take):
    """Frames that were seen while the take ran are frames that it kept."""
    raw = os.path.join(takes.folder(rig, take), "cam0", "raw")
    kept = set()
    for name in os.listdir(raw):
        with open(os.path.join(raw, name), "rb") as file:
            kept.add(file.read())
    bytes_of, = {len(pixels) for pixels in kept}
    with open(rig.path("plan.conf.frames"), "rb") as file:
        seen = file.read()
    payload = len(seen) // FRAMES
    assert bytes_of <= payload < bytes_of + 4096, (len(seen), bytes_of)  # what a frame says of itself
    assert kept.issuperset({seen[k * payload:][:bytes_of] for k in range(FRAMES)})


def check_factored(rig, take):
    """Spectra multiplied by lightstagectl are those that the daemon multiplies, file by file."""
    spectra = ("R", "A", "B")
    how = ("--lights", "0,7", "--model", "sphere", "--layout", "rgb", "--half", "--output")
    rig.control("fetch", take, "--channel", ",".join(spectra), "--factored", *how, rig.path("f"))
    for channel in spectra:
        rig.control("fetch", take, "--channel", channel, *how, rig.path("plain"))
        for light in (1, 8):
            with open(rig.path(f"plain.{light:04d}.exr"), "rb") as plain, \
                    open(rig.path(f"f.{channel}.{light:04d}.exr"), "rb") as factored:
                assert factored.read() == plain.read(), (channel, light)
    rig.control("fetch", take, "--channel", ",".join(spectra), *how, rig.path("s"))
    for name in (f"{c}.{light:04d}.exr" for c in spectra for light in (1, 8)):
        with open(rig.path("s." + name), "rb") as several, open(rig.path("f." + name), "rb") as factored:
            assert several.read() == factored.read(), name
    rig.control("fetch", take, "--channel", "R,B", "--full-sphere", "--output", rig.path("ball"))
    rig.control("fetch", take, "--channel", "B", "--full-sphere", "--output", rig.path("blue"))
    with open(rig.path("ball.B.exr"), "rb") as several, open(rig.path("blue.exr"), "rb") as alone:
        assert several.read() == alone.read() and os.path.exists(rig.path("ball.R.exr"))
    allowed = 0.2 * max(pictures.read(rig.path(f"f.{c}.0001.exr")).max() for c in spectra)
    said = json.loads(rig.control("fetch", take, "--channel", ",".join(spectra), "--factored",
                                  "--max-error", str(allowed), "--json", *how, rig.path("some")))
    worst = max(np.abs(pictures.read(rig.path(f"some.{c}.{n:04d}.exr")) -
                       pictures.read(rig.path(f"f.{c}.{n:04d}.exr"))).max()
                for c in spectra for n in (1, 8))
    assert 0 < worst <= said["error_bound"] <= allowed, (worst, said["error_bound"], allowed)


def test_takes_and_pictures_are_the_same_by_the_library_at_the_socket_and_by_tls(folder):
    rig = harness.twelve(folder, daemon_extra=LISTEN)
    rig.control("pki", "init", rig.path("pki"))
    rig.start()
    harness.stage.write(rig.path("plan.conf"), takes.KEEP_RAW)
    for who in None, "operator":
        code, pixels, said = by_library(rig, rig.path("plan.conf"), who)
        assert code == 0, said
        take = rig.takes()[-1]
        assert take["state"] == "complete", take
        assert said.split() == [take["id"], "state", "3", str(PICTURES), "conditions", "cameras",
                                "1", "told"], said
        expected = np.concatenate([p.ravel() for p in fetched_by_control(rig, take["id"])])
        assert expected.any() and np.array_equal(pixels, expected), who
        for other in None, "operator", "reader":
            code, again, said = by_library(rig, take["id"], other)
            assert code == 0 and np.array_equal(again, expected), (other, said)
        if who is None:
            check_frames(rig, take["id"])
    check_factored(rig, take["id"])
    before = len(rig.takes())
    code, _, said = by_library(rig, rig.path("plan.conf"), "reader")
    assert code == 1 and said.startswith("110: ") and len(rig.takes()) == before, said
    code, _, said = by_library(rig, take["id"], "server")
    assert code == 1 and said[0] in "124", said
    rig.control("pki", "add", rig.path("pki"), "stranger")
    code, _, said = by_library(rig, take["id"], "stranger")
    assert code == 1 and said.startswith("110: "), said


harness.main(globals())
