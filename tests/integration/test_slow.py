#!/usr/bin/python3 -B
"""A disk and a merge that cannot keep up (slow.c makes the real ones slow), a camera's network that
cannot, and a live subject."""
import os

import flashing
import harness
import takes

LIGHTS = 120
# 256 x 256 halves are 0.13 MB: of 72 a second the disk takes 24, and little may wait for it
DISK = {"LS_SLOW_DISK_BYTES_PER_S": "3200000"}
MERGE = {"LS_SLOW_MERGE_TIMES": "60"}  # of some 0.7 ms a picture, by two
PLANNED_FPS = 72


def plan(exposures, extra=""):
    return f"""subject = "live"; exposures_us = [{exposures}]; darks = 4; {extra}
conditions = ( {{ kind = "each"; channels = ["W"]; }} );
"""


def slowed(folder, knob):
    library = {"LD_PRELOAD": os.path.join(harness.BUILD, "tests", "integration", "libls_slow.so")}
    return harness.rig_of(folder, scene="stamp", size=256, environment={**library, **knob},
                          channels="WR", scene_extra=f"lights = {LIGHTS}; stamp_frames = 2;",
                          daemon_extra="queue_bytes = 1048576;")


def spared(folder, knob):
    """The take is whole at its first attempt, slower than planned, and nobody saw it flash."""
    rig = slowed(folder, knob).start()
    code, status, err = takes.photograph(rig, plan("2000"))
    assert code == 0 and status["state"] == "complete", (status, err)
    judged = takes.is_good(rig, status["id"], pixels=False)
    assert judged["shots_repaired"] == 0, judged
    seen = [t for t, _ in flashing.pulses(rig)]
    rate = (len(seen) - 1) / (seen[-1] - seen[0])
    print(f"# {rate:.1f} pulses a second", flush=True)
    assert len(seen) >= LIGHTS, len(seen)
    assert rate < 0.8 * PLANNED_FPS, f"{rate} a second: nothing slowed it"
    flashing.spares(rig)


def test_a_slow_disk_pauses_the_lights_and_neither_loses_nor_flashes(folder):
    spared(folder, DISK)


def test_a_slow_merge_pauses_the_lights_and_neither_loses_nor_flashes(folder):
    spared(folder, MERGE)


def test_a_slow_network_slows_the_lights_and_loses_nothing(folder):
    # frames one by one, each 25 to 75 ms after the one before: of 19 under way, as many as come in
    # half of a frame's patience of 0.54 s at the planned rate, the last would come after 0.95 s
    rig = harness.twelve(folder, f'{{ kind = "crowded"; at = {takes.FIRST_LIGHT}; value = 50; '
                                 'seed = 11; }', scene="stamp").start()
    code, status, err = takes.photograph(rig)
    assert code == 0 and status["state"] == "complete", (status, err)
    assert takes.is_good(rig, status["id"])["shots_repaired"] == 0, status
    seen = [t for t, _ in flashing.pulses(rig)]
    rate = (len(seen) - 1) / (seen[-1] - seen[0])
    print(f"# {rate:.1f} pulses a second", flush=True)
    assert rate < 0.5 * PLANNED_FPS, f"{rate} a second: nothing slowed it"


def test_three_exposures_of_a_live_subject_need_the_override(folder):
    rig = slowed(folder, {}).start()
    three = "500, 2000, 8000"
    code, _, err = takes.photograph(rig, plan(three))
    assert code != 0, "24 changes of light a second were not refused"
    takes.says(err, "24.0 Hz", "allow_flashing")
    assert takes.exposures(rig) == 0, "something was lit"
    code, status, err = takes.photograph(rig, plan(three, "allow_flashing = true;"))
    assert code == 0, (status, err)


if __name__ == "__main__":
    harness.main(globals())
