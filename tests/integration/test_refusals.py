#!/usr/bin/python3 -B
"""What must be refused before the first flash: the simulator's log stays empty, the exit code says
whose fault it is, and the sentence says what to do."""
import os

import harness
import takes
from harness import stage

EACH = '{ kind = "each"; channels = ["W"]; }'
SPHERE = '{ kind = "sphere"; channels = ["W"]; }'
# Limits that a plan can break: the reference rig's are wider than the plan's own.
LIMITS = "max_current_ma = 5000; min_period_us = 20000;"


def plan(exposures="[500, 2500, 12500]", conditions=EACH, subject="still", extra="", darks=4):
    return (f'subject = "{subject}"; exposures_us = {exposures}; darks = {darks};\n'
            f'conditions = ( {conditions} );\n{extra}\n')


def refused(rig, text, code, *words, name="take"):
    """Preflight and start both refuse, in the same words; nothing is fired and nothing is left."""
    path = takes.plan_file(rig, text)
    answers = [takes.ask(rig, "preflight", "--plan", path),
               takes.ask(rig, "take", "start", "--name", name, "--plan", path)]
    for found, _, err in answers:
        assert found == code, (found, err)
        takes.says(err, *words)
        assert err.count("\n") == 1, f"more than one line: {err}"
    dark_and_empty(rig)


def dark_and_empty(rig):
    assert takes.exposures(rig) == 0, "something was fired"
    assert os.listdir(rig.path("takes")) == [], os.listdir(rig.path("takes"))


def test_a_plan_that_is_no_plan_is_refused_with_its_line(folder):
    rig = harness.twelve(folder).start()
    for text, words in (
            ('exposures_us = [500];\nconditions = ();\n', ("subject", "still", "live")),
            (plan(subject="asleep"), ("plan:1", "subject", "still", "live")),
            (plan(extra="colour = 3;"), ("plan:3", "colour", "unknown")),
            (plan(exposures="[2500, 500]"), ("exposures_us", "shortest first")),
            (plan(exposures="[500, 2500.5]"), ("plan:1", "element type")),
            (plan(exposures="[]"), ("exposures_us",)),
            (plan(conditions=""), ("conditions", "nothing to photograph")),
            (plan(conditions='{ kind = "each"; channels = ["X"]; }'), ("X", "no such channel")),
            (plan(conditions='{ kind = "each"; channels = ["W"]; lights = [12]; }'), ("0 to 11",)),
            (plan(conditions=EACH + ", " + EACH), ("W-0000 is asked for twice",)),
            (plan(darks=0), ("darks",)),
            ("subject = ;", ("plan:1", "syntax error")),
            ("{" * 100000, ("plan:1",)),
            (plan(extra='@include "/etc/hostname"'), ("@include",)),
    ):
        refused(rig, text, 4, *words)


def test_a_bracket_with_gaps_is_refused(folder):
    rig = harness.twelve(folder).start()
    # linear from 0.10 to 0.85 of full scale: a step of 25 leaves a gap, 8.5 is the most
    refused(rig, plan(exposures="[500, 12500]"), 4, "exposures_us", "gap", "8.5 times")


def test_what_the_controller_does_not_bear_is_refused(folder):
    rig = harness.twelve(folder, controller_extra=LIMITS).start()
    refused(rig, plan(), 6, "period 13889 us", "shorter than the controller's 20000 us")
    slow = "period_us = 20000;"
    # 12 lights x 0.7 A at full level are 8.4 A
    refused(rig, plan(conditions='{ kind = "sphere"; channels = ["W"]; level = 65535; }',
                      extra=slow), 6, "current 8400 mA", "5000 mA", "dim it or light fewer")
    # one LED for 0.1, 0.2 and 0.4 s in little more than one second; half a second is allowed
    refused(rig, plan(exposures="[100000, 200000, 400000]"), 6, "light address [0-9]+ channel 0",
            "controller's 500.000 ms", "lengthen the period or shorten the pulses")
    refused(rig, plan(exposures="[510, 2500, 12500]", conditions=SPHERE, extra=slow), 6,
            "dimmed pulse of 510 us", "use 500 us")
    refused(rig, plan(exposures="[20, 100, 500]", extra=slow), 6, "pulse 20 us",
            "shorter than the controller's 50 us")
    refused(rig, plan(extra="period_us = 1000;"), 4, "period_us", "13889")


def test_a_hold_too_short_for_a_software_trigger_is_refused(folder):
    rig = harness.twelve(folder, controller_extra="max_hold_us = 110000;",
                         rig_camera_extra='trigger = "software";').start()
    refused(rig, plan(), 6, "12500 us", "longest hold of 110000 us", "shorter exposures")


def test_a_live_subject_is_not_flashed_at_3_to_30_hz_unless_it_is_asked_for(folder):
    rig = harness.twelve(folder).start()
    refused(rig, plan(subject="live"), 6, "live subject", "24.0 Hz", "allow_flashing")
    refused(rig, plan(subject="live", exposures="[12500]", extra="period_us = 50000;"), 6,
            "20.0 Hz", "allow_flashing")
    code, out, err = takes.ask(rig, "preflight", "--plan", takes.plan_file(
        rig, plan(subject="live", exposures="[12500]")))
    assert code == 0, err  # 72 Hz, and every pulse another light
    code, status, err = takes.photograph(rig, plan(subject="live", extra="allow_flashing = true;"))
    assert code == 0 and status["state"] == "complete", err


def test_a_disk_too_full_for_the_take_is_said_before_the_first_flash(folder):
    rig = harness.twelve(folder, daemon_extra=f"reserve_bytes = {1 << 49}L;").start()
    refused(rig, plan(), 7, "stay reserved", "free in", "make room or choose another",
            "storage full")


def test_a_disk_that_is_really_full_is_said_before_the_first_flash(folder):
    rig = harness.twelve(folder)
    os.mkdir(rig.path("takes"))
    if takes.call_quietly("mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", rig.path("takes")):
        raise harness.Skip("cannot mount a small file system here")
    try:
        # a take's document alone may need 8 MB: daemon/preflight.c
        rig.daemon_extra = "reserve_bytes = 0;"
        rig.start()
        refused(rig, plan(), 7, "make room or choose another", "storage full")
        assert rig.daemon.stop() is None
    finally:
        takes.call_quietly("umount", rig.path("takes"))


def test_no_camera_at_the_address_is_said(folder):
    rig = harness.twelve(folder)
    rig.addresses = [stage.loopback(9)]
    rig.start()
    refused(rig, plan(), 6, f"camera 0 \\({rig.addresses[0]}\\)", "nobody answers")
    status = rig.ask("status")
    assert not status["cameras"][0]["connected"] and status["lights"]["connected"], status


def test_no_controller_is_said(folder):
    rig = harness.twelve(folder).start()
    assert rig.dome.stop() is None
    refused(rig, plan(), 6, "dome controller", "127.0.0.1")
    assert not takes.lights_status(rig)["connected"]
    code, _, err = takes.ask(rig, "blank")
    assert code == 6, (code, err)


def test_a_black_level_that_clips_is_refused_before_the_first_flash(folder):
    rig = harness.twelve(folder, camera_extra="black = 0.0;").start()
    refused(rig, plan(), 6, "BlackLevel", "above 0")


def test_a_black_level_that_clips_unsaid_is_noticed_in_the_darks(folder):
    # read noise of 20 electrons is 0.0019 of full scale, as much as the black level: the camera
    # says that it is above 0, its dark frames show one pixel in six cut off
    rig = harness.twelve(folder, camera_extra="black = 0.002; read_noise_e = 20.0;").start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], "black")
    lit = [e for e in harness.shown(rig) if e["kind"] != "dark"]
    assert not lit, lit[0]


def test_a_name_or_a_token_with_tricks_is_refused(folder):
    rig = harness.twelve(folder).start()
    path = takes.plan_file(rig, plan())
    for name in ("../x", "a/b", "..", ".", "", "x" * 65, "a b", "a\nb", "\u00e9", "-/../x", "%s%n"):
        code, _, err = takes.ask(rig, "take", "start", f"--name={name}", "--plan", path)
        assert code == 4, (name, code, err)
        takes.says(err, "1 to 64 letters, digits, - or _")
    for token in ("a b", "\u00e9", "a\nb"):
        code, _, err = takes.ask(rig, "take", "start", f"--token={token}", "--plan", path)
        assert code == 4, (token, code, err)
        takes.says(err, "token")
    for command in (("take", "show"), ("take", "verify"), ("take", "resume")):
        for take in ("../takes", "/etc", "..", "a" * 4000, "20200101T000000Z-x-abcdef"):
            code, _, err = takes.ask(rig, *command, take)
            assert code == 5, (command, take, code, err)
    dark_and_empty(rig)


def daemon_says(rig, *words):
    """The daemon does not start: exit code 1, and a line of this kind."""
    try:
        rig.daemon = stage.Process(rig.path("daemon.log"), rig.program("daemon/lightstaged"),
                                   "--config", rig.path("daemon.conf"))
    except harness.Failed as failed:
        takes.says(str(failed), *words)
        assert failed.code == 1, failed.code
        return
    raise AssertionError("the daemon started")


def change(rig, name, old, new):
    text = stage.read(rig.path(name))
    assert old in text, (old, text)
    stage.write(rig.path(name), text.replace(old, new))


def line_of(rig, name, text):
    lines = stage.read(rig.path(name)).splitlines()
    return next(k for k, line in enumerate(lines, 1) if text in line)


def test_a_wrong_configuration_is_refused_with_file_and_line_and_what_was_expected(folder):
    rig = harness.twelve(folder)
    rig.start_simulator()
    for name, old, new, words in (
            ("daemon.conf", 'socket = "socket";', 'socket = "socket";\nsockets = 1;',
             ("sockets", "unknown")),
            ("daemon.conf", 'rig = "rig.conf";', 'rig = "rig.conf";\nretries = 1000;',
             ("retries", "0 to 100")),
            ("daemon.conf", 'driver = "modbus"', 'driver = 7', ("driver", "string")),
            ("rig.conf", "max_fps = 72", "max_fps = -72", ("max_fps", "expected")),
            ("rig.conf", "range = [0.10, 0.85]", "range = [0.85, 0.10]", ("range", "low < high")),
            ("rig.conf", 'right,up,towards', 'right,up,left', ("axes", "right.left, up.down")),
            ("rig.conf", 'unit = "m"', 'unit = "ell"', ("unit", '"m" or "cm" or "mm"')),
    ):
        rig.write_configuration()
        change(rig, name, old, new)
        line = line_of(rig, name, new.splitlines()[-1])
        daemon_says(rig, f"{name}:{line}: ", *words)
    rig.write_configuration()
    change(rig, "daemon.conf", 'rig = "rig.conf"', 'rig = "nowhere.conf"')
    daemon_says(rig, "nowhere.conf", "key rig")


if __name__ == "__main__":
    harness.main(globals())
