#!/usr/bin/python3 -B
"""What a camera sees while one looks: focus and clipping under steady light, and frames of takes, which
nobody who looks holds up."""
import json
import struct
import subprocess

import harness
import takes
import wire
from harness import stage

EXPOSURE_US, PREVIEW = "20000", 18


def look(rig, *options, frames=3):
    """The last of a few pictures' figures."""
    out = rig.control("preview", "--exposure", EXPOSURE_US, "--frames", str(frames), "--json",
                      *options, timeout=60)
    lines = [json.loads(line) for line in out.splitlines()]
    assert len(lines) == frames, out
    return lines[-1]


def begin_looking(rig, *options):
    """A client that looks on, once it has had its first picture."""
    client = subprocess.Popen(takes.ctl(rig, "preview", "--json", *options), text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              stdin=subprocess.DEVNULL, preexec_fn=stage.die_with_parent)
    line = client.stdout.readline()
    assert line, client.stderr.read()
    return client, json.loads(line)


def lights_now(rig):
    """What the controller says of this moment; of a live view's, nothing."""
    lights = rig.ask("status")["lights"]
    return lights["now"] if lights["serial"] else None


def is_dark(rig):
    """Nothing is to be seen without a light of ours: the simulated stage has no other."""
    seen = look(rig)
    return seen["focus"] == 0 and max(seen["clip"]) == 0


def test_blur_lowers_the_focus_figure_and_light_raises_clipping(folder):
    focus = []
    for blur in (0, 1.2):
        rig = harness.twelve(folder, blur_px=blur).start()
        focus.append(look(rig, "--light", "W", "--level", "5")["focus"])
        if blur == 0:
            file = rig.path("look.png")
            clips = [look(rig, "--light", "W", "--level", level, "--output", file)["clip"]
                     for level in ("1", "20", "50")]
            assert clips[0] == [0, 0, 0], clips
            assert sum(clips[0]) < sum(clips[1]) < sum(clips[2]), clips
            with open(file, "rb") as png:
                assert png.read(24)[16:] == struct.pack(">II", 64, 64), "128 px by twos"
            assert is_dark(rig), "the light stayed on"
        assert not rig.stop()
    assert focus[0] > 1.1 * focus[1] > 0, focus


def test_the_light_goes_out_with_whoever_asked_for_it(folder):
    rig = harness.twelve(folder).start()
    client, first = begin_looking(rig, "--exposure", EXPOSURE_US, "--light", "W")
    assert first["focus"] > 0, first
    code, _, err = takes.ask(rig, "preview", "--exposure", EXPOSURE_US, "--frames", "1")
    assert code == 5, (code, err)
    takes.says(err, "another client has the live view", "201")
    client.kill()
    client.wait()
    harness.wait_for("the light is out", lambda: lights_now(rig) == [])
    assert is_dark(rig)

    client, _ = begin_looking(rig, "--exposure", EXPOSURE_US, "--light", "R")
    rig.control("blank")
    _, err = client.communicate(timeout=30)
    assert client.returncode == 5, err
    takes.says(err, "all lights were turned off", "205")
    assert is_dark(rig)

    client, _ = begin_looking(rig, "--exposure", EXPOSURE_US, "--light", "R")
    assert harness.work_light(rig)
    rig.daemon.kill()
    client.wait()
    harness.wait_for("the controller puts the light out", lambda: not harness.work_light(rig))
    rig.start_daemon()
    assert lights_now(rig) == []


def test_a_work_light_that_was_on_comes_back(folder):
    work = 'work_light = { channel = "R"; level = 2000; };'
    rig = harness.twelve(folder, daemon_extra=work).start()
    look(rig, "--light", "W", "--level", "2")
    harness.wait_for("dark as before", lambda: lights_now(rig) == [])
    takes.photograph(rig, harness.PLAN)
    assert lights_now(rig) == ["work light"]
    red = look(rig)["focus"]
    assert red > 0 and look(rig, "--light", "W", "--level", "2")["focus"] > 0
    harness.wait_for("lit as before", lambda: lights_now(rig) == ["work light"])
    assert abs(look(rig)["focus"] / red - 1) < 0.2, "another light than before"


def test_a_light_over_the_limits_or_dimmed_too_slowly_is_refused(folder):
    rig = harness.twelve(folder).start()
    code, _, err = takes.ask(rig, "preview", "--exposure", "1000", "--light", "W", "--level", "60")
    assert code == 6, (code, err)
    takes.says(err, "303", "500|50 %|duty")
    code, _, err = takes.ask(rig, "preview", "--exposure", "1000", "--light", "X")
    assert code == 4, (code, err)
    assert not rig.stop()
    rig = harness.twelve(folder, controller_extra="pwm_period_us = 10000; min_pulse_us = 10000;").start()
    code, _, err = takes.ask(rig, "preview", "--exposure", "1000", "--light", "W")
    assert code == 6, (code, err)
    takes.says(err, "100 Hz", "more than 200 Hz")


def deaf_client(rig):
    """A connection that asks for pictures of takes and never reads."""
    peer = wire.Peer(rig.path("socket"))
    assert peer.send(wire.hello() + wire.frame(PREVIEW, request=2))
    return peer


def test_nobody_who_looks_holds_a_take_up(folder):
    # a picture has 108 KiB: four, and a socket is full
    rig = harness.twelve(folder, scene="stamp", size=384).start()
    deaf = [deaf_client(rig) for _ in range(3)]
    with open(rig.path("seen"), "w", encoding="utf-8") as seen:
        client = subprocess.Popen(takes.ctl(rig, "preview", "--json"), stdout=seen, stderr=seen,
                                  stdin=subprocess.DEVNULL, preexec_fn=stage.die_with_parent)
    code, status, err = takes.photograph(rig, takes.LONG)
    client.kill()
    client.wait()
    assert code == 0 and status["shots_lost"] == 0, (err, status, rig.ask("metrics"))
    takes.is_good(rig, status["id"])
    pictures = [json.loads(line) for line in stage.read(rig.path("seen")).splitlines()]
    skipped = rig.ask("metrics")["pictures_skipped"]
    assert len(pictures) >= 3 and skipped >= 3, (len(pictures), skipped)
    for peer in deaf:
        peer.close()


def test_a_take_ends_the_live_view_and_refuses_another(folder):
    rig = harness.twelve(folder).start()
    client, _ = begin_looking(rig, "--exposure", EXPOSURE_US, "--light", "W")
    take = takes.begin(rig, takes.LONG)
    _, err = client.communicate(timeout=30)
    assert client.returncode == 5, err
    takes.says(err, "a take begins", "201")
    code, _, err = takes.ask(rig, "preview", "--exposure", EXPOSURE_US, "--light", "W")
    assert code == 5, (code, err)
    takes.says(err, take, "running")
    code, status = takes.ended(rig)
    assert code == 0 and status["shots_lost"] == 0, status
    takes.is_good(rig, take, pixels=False)


if __name__ == "__main__":
    harness.main(globals())
