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


def preflight(rig):
    """All that it warns of."""
    return str(rig.ask("preflight", "--plan", takes.plan_file(rig, PLAN))["warnings"])


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
    told = takes.alarm(rig)
    assert told["kind"] == "sweep", told
    takes.says(told["text"], "1 LEDs give no light: R-0007")
    alarms = [a for a in alarms if not a.startswith("camera ")]  # packets, on a busy machine
    assert alarms == checks["warnings"] and len(alarms) == 2, alarms
    swept = rig.takes()[-1]["id"]
    says = "1 LEDs give no light: R-0007; 1 LEDs are dim: W-0021 (sweep "
    assert says + swept in preflight(rig), preflight(rig)
    told = takes.document(rig, rig.start_take("after", PLAN))
    assert told["led_sweep"]["take"] == swept, told["led_sweep"]
    assert told["led_sweep"]["dead"] == checks["leds"]["dead"]
    assert told["led_sweep"]["dim"] == checks["leds"]["dim"]
    sweep(rig)  # a newer one takes its place
    assert says + rig.takes()[-1]["id"] in preflight(rig), preflight(rig)


def test_ambient_light_and_clipping_are_told_with_what_to_do(folder):
    # radiance 0.0025 while the shutter is open for 4 ms, where 0.29 reads half of full scale
    rig = harness.twelve(folder, scene_extra=DOME, camera_extra="ambient = 0.0025;").start()
    checks, message, _ = sweep(rig, """subject = "still"; exposures_us = [1600, 4000]; darks = 8;
conditions = ( { kind = "sphere"; channels = ["W"]; level = 65535; },
               { kind = "sphere"; channels = ["R", "G"]; level = 4000; } );""")
    takes.says(message, "clipping: .* of camera front is saturated under sphere-W even at 1600 us: "
               "begin the bracket at 800 us")
    assert len([w for w in checks["warnings"] if "clipping" in w]) == 1, checks["warnings"]
    ambient = [w for w in checks["warnings"] if "ambient" in w]
    assert len(ambient) == 1 and "darken the room" in ambient[0], checks["warnings"]
    # 0.0025 / 0.286 of half of full scale
    assert 0.0025 < checks["ambient"][0]["dn"] / 4095 < 0.006, checks["ambient"]
    assert not checks["leds"]["dead"] and not checks["leds"]["dim"], checks["leds"]


LOAD = """subject = "still"; exposures_us = [1000, 4000]; darks = 8; period_us = 50000;
conditions = ( { kind = "segment"; channels = ["W"]; lights = [0, 1, 4]; level = 32768; },
               { kind = "each"; channels = ["W"]; lights = [1]; } );
"""


def test_a_plan_is_weighed_before_it_is_shot_and_the_take_holds_it(folder):
    rig = harness.twelve(folder, controller_extra="led_power_mw = 2000;").start()
    said = rig.ask("preflight", "--plan", takes.plan_file(rig, LOAD))
    # 5 ms of three LEDs at half, 5 ms of one: 2.5 LED-times 5 ms times 2 W
    assert abs(said["energy_j"] - 0.025) < 1e-6, said
    assert abs(said["peak_current_a"] - 1.5 * 0.7) < 1e-4, said
    # LED 1 is lit 5 ms at half and 5 ms whole, of 20 steps of 50 ms
    assert abs(said["led_duty"] - 0.0075 / 1.0) < 1e-6 and abs(said["seconds"] - 1.0) < 1e-9, said
    code, out, _ = takes.ask(rig, "preflight", "--plan", rig.path("plan.conf"))
    takes.says(out, r"LEDs +0 J, at most 1.1 A, the busiest lit 0.75 % of the time")
    code, status, err = takes.photograph(rig, LOAD)
    assert code == 0, err
    held = takes.document(rig, status["id"])["preflight"]
    for key in ("energy_j", "peak_current_a", "led_duty", "seconds", "bytes", "dark_noise_share"):
        assert held[key] == said[key], (key, held, said)
    assert held["warnings"] == said["warnings"].splitlines(), held


if __name__ == "__main__":
    harness.main(globals())
