#!/usr/bin/python3 -B
"""Every kind of a plan, photographed by the real daemon: is a picture the sum of its lights?"""
import json
import os

import numpy as np

import harness
import pictures
import takes

LIGHTS, DROOP, PWM_STEPS = 12, 1.2, 1000
PLAN = """subject = "still"; exposures_us = [800, 6400]; darks = 32; reference = { level = 10922; };
conditions = ( { kind = "each"; channels = ["W", "V", "H"]; },
               { kind = "sphere"; channels = ["W"]; level = 10922; },
               { kind = "segment"; channels = ["W"]; lights = [2, 3, 11]; level = 20000; },
               { kind = "segments"; count = 5; channels = ["W"]; },
               { kind = "headlight"; channels = ["W"]; },
               { kind = "multiplex"; channels = ["W"]; level = 10922; },
               { kind = "harmonics"; channels = ["W"]; degree = 1; level = 10922; },
               { kind = "harmonics"; channels = ["V"]; degree = 1; form = "biased"; level = 30000; },
               { kind = "gradients"; channels = ["W"]; level = 10922; } );
"""
CHANNELS = """channels = ( { name = "W"; kind = "spectrum"; spectrum = "white"; droop = 1.2; },
    { name = "V"; kind = "vertical"; spectrum = "white"; droop = 1.0; },
    { name = "H"; kind = "horizontal"; spectrum = "white"; droop = 1.0; } );"""


def weights(condition):
    """What each light really gives, of full: duty in the hardware's steps, and the supply's sag."""
    lights = condition.get("lights", range(LIGHTS))
    levels = condition.get("levels", [condition["level"]] * len(lights))
    # a segment of one light sags no more than one light does
    droop = 1 + ((DROOP if condition["channel"] == "W" else 1) - 1) * (len(lights) - 1) / (LIGHTS - 1)
    out = np.zeros(LIGHTS)
    for light, level in zip(lights, levels):
        out[light] = round(level / 65535 * PWM_STEPS) / PWM_STEPS / droop
    return out


def test_every_picture_is_the_sum_of_the_lights_its_plan_says(folder):
    rig = harness.twelve(folder, size=96, channels="WVH",
                         scene_extra=f"lights = {LIGHTS}; {CHANNELS}").start()
    code, status, err = takes.photograph(rig, PLAN)
    assert code == 0 and status["state"] == "complete", err
    judged = rig.judge(status["id"])
    assert judged["frames_mislabeled"] == 0 and judged["shots_lost"] == 0, judged
    home = takes.folder(rig, status["id"])
    document = json.loads(harness.stage.read(os.path.join(home, "take.json")))
    plan = [c for c in document["plan"]["conditions"] if c["kind"] != "dark"]
    picture = {c["id"]: pictures.read(os.path.join(home, "cam0", c["id"] + ".exr"))[:, :, 0]
               for c in plan}
    # what is saturated even in the shortest exposure, under a single light, adds up to nothing
    high = (0.85 - 1 / 64) / document["exposure_s"][0] * document["reference_exposure_s"]
    good = np.all([p < high for p in picture.values()], axis=0)
    assert good.mean() > 0.9, good.mean()
    worst, seen = 0, set()
    for c in plan:
        if c["kind"] == "one":
            continue
        seen.add(c.get("pattern"))  # a reference has none, and is a sphere all the same
        w = weights(c)
        expected = sum(w[i] * picture[f"{c['channel']}-{i:04d}"] for i in range(LIGHTS))
        total, wanted = picture[c["id"]][good].mean(), expected[good].mean()
        spread = np.corrcoef(picture[c["id"]].ravel(), expected.ravel())[0, 1]
        worst = max(worst, abs(total / wanted - 1) if wanted > 0.01 else 0)
        # Mean over 9216 pixels. Read noise of 5 / 10500 of full scale at 6.4 ms, in stored values:
        # 2.4e-5 of each picture, so 1e-4; the half floats' rounding and shot noise: 0.3 %. A droop or
        # a level left out shows 1.8 %, a swapped light more.
        assert abs(total - wanted) < 0.003 * wanted + 1e-4, (c["id"], total, wanted)
        assert spread > 0.98, (c["id"], spread)
    print(f"# worst of {len(plan) - 3 * LIGHTS} pictures: {100 * worst:.2f} %")
    assert {"sphere", "lights-3", "segments-5", "headlight", "multiplex", "harmonic-00p",
            "harmonic-03n", "harmonic-03", "gradient-x", "gradient-full"} <= seen, seen
    segments = [c for c in plan if c.get("pattern") == "segments-5"]
    assert sorted(i for c in segments for i in c["lights"]) == list(range(LIGHTS)), segments
    assert sorted(c["part"] for c in segments) == [0, 1, 2, 3, 4], segments
    # 12 lights want the matrix of order 19: half of its columns are lights
    rows = [c for c in plan if c.get("pattern") == "multiplex"]
    assert len(rows) == 19 and rows[7]["id"] == "multiplex-W-0007", len(rows)


def example():
    """lightstage-plan(5)'s."""
    page = harness.stage.read(os.path.join(harness.ROOT, "daemon", "lightstage-plan.5.scd"))
    return page.split("# EXAMPLE")[1].split("```")[1]


def test_a_pattern_without_a_factor_is_said_before_and_in_the_take(folder):
    rig = harness.twelve(folder).start()
    plan = PLAN.replace("10922", "728")
    cost = rig.ask("preflight", "--plan", takes.plan_file(rig, example()))
    assert cost["shots"] >= 3 * (64 + LIGHTS + 2), cost  # and references; the manual's own plan
    text = takes.plan_file(rig, plan)
    warnings = rig.ask("preflight", "--plan", text)["warnings"].splitlines()
    said = [w for w in warnings if "not calibrated" in w]
    # the full sphere and the head light at their usual levels are calibrated; each pattern is told of once, at most eight
    assert said[0].startswith("lights-3 in W at duty 0.30518"), said
    assert said[1].startswith("segments-5 in W at duty"), said
    assert said[2].startswith("multiplex in W at duty 0.01111 (multiplex-W-0000 ...)"), said
    assert len(said) == 9 and said[8].endswith("more patterns are not calibrated"), said
    code, status, err = takes.photograph(rig, plan)
    assert code == 0 and status["state"] == "complete", err
    document = takes.document(rig, status["id"])
    missing = document["plan"]["uncalibrated"]
    lit = [c["id"] for c in document["plan"]["conditions"] if c.get("pattern")]
    assert missing == [i for i in lit if i not in ("sphere-W", "headlight-W")], missing


if __name__ == "__main__":
    harness.main(globals())
