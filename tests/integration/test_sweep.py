#!/usr/bin/python3 -B
"""A preflight that fires: dead and dim LEDs by name, clipping, ambient light; and no false alarms."""
import json

import harness
import takes

PLAN = """subject = "still"; exposures_us = [500, 4000]; darks = 8;
conditions = ( { kind = "sphere"; channels = ["W", "R", "G"]; level = 4000; },
               { kind = "each"; channels = ["W", "R", "G"]; lights = [0, 1]; } );
"""
DOME = "lights = 60;"


def sweep(rig, plan=PLAN):
    """A sweep to its end: (what it found, its message, its alarms)."""
    code, out, err = takes.ask(rig, "take", "start", "--plan", takes.plan_file(rig, plan), "--sweep",
                               "--json")
    assert code == 0, err
    status = json.loads(out)
    assert status["state"] == "complete", status
    document = takes.document(rig, status["id"])
    lit = [c for c in document["plan"]["conditions"] if c["kind"] != "dark"]
    assert len(lit) == 3 * 61 and all(c["steps"] == 1 for c in lit), len(lit)
    assert takes.ask(rig, "take", "verify", status["id"])[0] == 0
    print("#", document["checks"]["warnings"], len(document["checks"]["leds"]["unseen"]),
          document["checks"]["clipping"])
    return document["checks"], status["message"], takes.alarms(rig, status["id"])


def names(leds):
    return sorted(f"{led['channel']}-{led['light']:04d}" for led in leds)


def test_a_sound_rig_is_found_sound(folder):
    rig = harness.twelve(folder, scene_extra=DOME).start()
    checks, message, alarms = sweep(rig)
    assert not checks["leds"]["dead"] and not checks["leds"]["dim"], checks["leds"]
    # what the camera cannot see is said, and is not much
    assert checks["leds"]["judged"] + len(checks["leds"]["unseen"]) == 3 * 60
    assert checks["leds"]["judged"] >= 110, checks["leds"]
    assert not checks["warnings"] and message == "complete; nothing wrong was found", message
    assert {c["channel"] for c in checks["clipping"]} == {"W", "R", "G"}
    assert all(c["share"] < 0.005 for c in checks["clipping"]), checks["clipping"]
    assert abs(checks["ambient"][0]["dn"]) < 1, checks["ambient"]


def test_dead_and_dim_leds_are_named_and_no_others(folder):
    rig = harness.twelve(folder, scene_extra=DOME + """
        led_faults = ( { light = 7; channel = "R"; strength = 0.0; },
                       { light = 21; channel = "W"; strength = 0.4; },
                       { light = 30; channel = "G"; strength = 0.85; } );""").start()
    checks, message, alarms = sweep(rig)
    assert names(checks["leds"]["dead"]) == ["R-0007"], checks["leds"]
    assert names(checks["leds"]["dim"]) == ["W-0021"], checks["leds"]
    assert abs(checks["leds"]["dim"][0]["share"] - 0.4) < 0.1, checks["leds"]["dim"]
    takes.says(message, "1 LEDs give no light: R-0007", "1 LEDs are dim: W-0021")
    assert alarms == checks["warnings"] and len(alarms) == 2, alarms


def test_ambient_light_and_clipping_are_told_with_what_to_do(folder):
    # radiance 0.05 while the shutter is open for 4 ms, where 0.29 reads half of full scale
    rig = harness.twelve(folder, scene_extra=DOME, camera_extra="ambient = 0.05;").start()
    checks, message, _ = sweep(rig, """subject = "still"; exposures_us = [1600, 4000]; darks = 8;
conditions = ( { kind = "sphere"; channels = ["W"]; level = 65535; },
               { kind = "sphere"; channels = ["R", "G"]; level = 4000; } );""")
    takes.says(message, "clipping: .* of camera front is saturated under sphere-W even at 1600 us: "
               "begin the bracket at 800 us")
    assert len([w for w in checks["warnings"] if "clipping" in w]) == 1, checks["warnings"]
    ambient = [w for w in checks["warnings"] if "ambient" in w]
    assert len(ambient) == 1 and "darken the room" in ambient[0], checks["warnings"]
    # 0.05 / 0.286 of half of full scale
    assert 0.05 < checks["ambient"][0]["dn"] / 4095 < 0.12, checks["ambient"]
    assert not checks["leds"]["dead"] and not checks["leds"]["dim"], checks["leds"]


if __name__ == "__main__":
    harness.main(globals())
