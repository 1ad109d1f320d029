#!/usr/bin/python3 -B
"""A camera of somebody else's: Debian's simulated one, by hold/release and software trigger."""
import fcntl
import os
import subprocess

import harness
import takes

ADDRESS = "127.0.0.1"  # the only one it listens on
WIDTH, HEIGHT = 256, 192
PLAN = """subject = "still"; exposures_us = [1000, 8000]; darks = 3; keep_raw = true;
conditions = ( { kind = "each"; channels = ["W"]; lights = [0, 5, 11]; },
               { kind = "sphere"; channels = ["W"]; } );"""
SHOTS = 2 * 3 + 2 * 3 + 2


def test_debian_s_camera_takes_a_short_plan_and_what_it_cannot_do_is_listed(folder):
    program = harness.need("arv-fake-gv-camera-0.8")
    with open(program, "rb") as turn:  # one at a time on this machine
        fcntl.flock(turn, fcntl.LOCK_EX)
        camera = subprocess.Popen([program, "-i", ADDRESS], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL,
                                  preexec_fn=harness.stage.die_with_parent)
        try:
            short_plan(folder)
        finally:
            camera.terminate()
            camera.wait()


def short_plan(folder):
    # the simulator is the dome alone; its own camera is never asked
    rig = harness.twelve(folder, size=(WIDTH, HEIGHT), cfa="mono", pixel_format="Mono8",
                         calibrated=False,
                         rig_camera_extra='trigger = "software"; black_check = false;')
    rig.addresses = [ADDRESS]
    rig.start()
    code, status, error = takes.photograph(rig, PLAN)
    assert code == 0, (status, error)
    take = status["id"]
    assert takes.ask(rig, "take", "verify", take)[0] == 0
    tickets = [t for t in takes.records(rig, take, "ticket") if t["status"] == "ok"]
    stored = {t["shot"]: t for t in tickets}
    assert sorted(stored) == list(range(SHOTS)), sorted(stored)
    for shot, ticket in stored.items():
        with open(os.path.join(takes.folder(rig, take), "cam0", "raw",
                               f"{shot}-{ticket['attempt']}.raw"), "rb") as file:
            raw = file.read()
        assert len(raw) == ticket["raw_bytes"] == WIDTH * HEIGHT
        assert takes.crc32c(raw) == ticket["raw_crc32c"]
    assert len(takes.published(rig, take)) == 2 + 3 + 1
    said = takes.document(rig, take)["rig"]["cameras"][0]
    print(f"# {said['vendor']} {said['model']}, unverified: {said['unverified']}")
    for feature in ("ExposureMode", "SensorShutterMode", "ChunkModeActive"):
        assert feature in said["unverified"], said["unverified"]
    rig.stop()


harness.main(globals())
