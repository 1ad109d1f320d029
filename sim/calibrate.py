"""The demo's own calibration: an operator who puts objects on the simulated stage, and the judge who
knows what should have come out."""
import json
import math
import os
import subprocess
import time

import rig as stage

SCENES = ["grey", "chrome", "gloss"]  # in the order lightstagectl calibrate asks for them
PROMPT = b"press Enter: "
# One exposure each: every light of the grey sphere in range, no highlight above it. Darks common to
# all pictures average out over a sphere's pixels.
EXPOSURES = ["--grey-exposures", "12000", "--chrome-exposures", "50", "--gloss-exposures", "200",
             "--darks", "16"]


def region(size):
    """The middle of the picture around a sphere of 0.1 m radius at 1.6 m, in pixels."""
    wanted = 2 * 25 / stage.SENSOR_MM * size * 0.1 / math.sqrt(1.6 ** 2 - 0.1 ** 2) * 1.5
    return min(size, size - (size - int(wanted)) // 4 * 4)


def answer(rig, process, say=lambda text: None):
    """Put the next object in place whenever the client asks for one; returns all it said."""
    said, scenes = b"", iter(SCENES)
    while byte := process.stderr.read(1):
        said += byte
        if not said.endswith(PROMPT):
            continue
        scene = next(scenes)
        say(f"placing the {scene} sphere")
        if scene != SCENES[0]:
            rig.place(scene)
        process.stdin.write(b"\n")
        process.stdin.flush()
    return said.decode()


def measure(build, folder, size):
    """Calibrate a rig of its own; returns the file and what the client reports."""
    os.makedirs(folder)
    side = region(size)
    rig = stage.Rig(build, folder, size, scene=SCENES[0], region=(side, side))
    out = rig.path("measured.json")
    try:
        rig.start()
        client = subprocess.Popen(
            [rig.program("clients/lightstagectl"), "--socket", rig.path("socket"), "calibrate",
             "--output", out, "--base", rig.path("calibration.json"), "--json", *EXPOSURES],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=stage.die_with_parent)
        said = answer(rig, client, stage.say)
        report = client.stdout.read()
        if client.wait():
            raise stage.Failed(said.strip().splitlines()[-1] if said.strip() else "calibrate failed")
    finally:
        wrong = rig.stop()
    if wrong:
        raise stage.Failed("; ".join(wrong))
    return out, json.loads(report)


def rms(values):
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def angle(a, b):
    dot = sum(x * y for x, y in zip(a, b))
    return math.degrees(math.acos(max(-1.0, min(1.0, dot))))


def honest(m, g, channel, sure, common):
    """Of one channel: the share of lights, in percent, whose own error is within its own sigma, and
    the error common to all in sigmas of what is stated of it. With one camera nobody sees the lights
    behind the sphere, and the mean of all, which every k is relative to, is known no better than
    these lights spread."""
    off = [math.log(m["k"][channel][i] / g["k"][channel][i]) for i in sure]
    sigma = [m["sigma_k"][channel][i] / m["k"][channel][i] for i in sure]
    own = [math.sqrt(max(s * s - common * common, 1e-12)) for s in sigma]
    mean = sum(o / s ** 2 for o, s in zip(off, own)) / sum(1 / s ** 2 for s in own)
    within = sum(abs(o - mean) < s for o, s in zip(off, own))
    return 100 * within / len(sure), mean / common


def factor_errors(m, g):
    """Percent, by pattern: the largest error of a factor over channels, at the duties that both
    know."""
    given = {(f["channel"], f["pattern"], round(f["duty"], 6)): f["factor"]
             for f in g["pattern_factors"]}
    out = {}
    for f in m["pattern_factors"]:
        factor = given.get((f["channel"], f["pattern"], round(f["duty"], 6)))
        if factor:
            error = abs(100 * (f["factor"] / factor - 1))
            out[f["pattern"]] = max(out.get(f["pattern"], 0), error)
    return out


def compare(measured, given, report):
    """How far the measured calibration is from the one the simulator gives: the table's keys."""
    with open(measured, encoding="utf-8") as file:
        m = json.load(file)
    with open(given, encoding="utf-8") as file:
        g = json.load(file)
    flagged = {i for lights in m["lights"].get("flags", {}).values() for i in lights}
    sure = [i for i in range(len(g["k"]["W"])) if i not in flagged]
    residuals = report["residuals"]
    k = {s: [100 * (m["k"][s][i] / g["k"][s][i] - 1) for i in sure] for s in g["k"]}
    common = {s: residuals[f"of that, common to all lights of {s}"] / 100 for s in k}
    honesty = {s: honest(m, g, s, sure, common[s]) for s in k}
    angles = [angle(m["lights"]["measured_direction"][i], g["lights"]["direction"][i])
              for i in sure]
    p = [100 * (a / b - 1) for s in g["p"] for a, b in zip(m["p"][s], g["p"][s])]
    factors = factor_errors(m, g)
    return {
        "k_lights": len(sure),
        "k_error_percent": rms([v for values in k.values() for v in values]),
        "k_worst_percent": max(abs(v) for values in k.values() for v in values),
        "k_within_sigma_percent": sum(w for w, _ in honesty.values()) / len(honesty),
        "k_within_sigma_by_channel": {s: w for s, (w, _) in honesty.items()},
        "k_common_error_sigma": max(abs(z) for _, z in honesty.values()),
        "direction_error_deg": rms(angles),
        "chrome_direction_error_deg":
            residuals["directions by the chrome ball, rms from the rig file"],
        "droop_error_percent": max(factors.values()),
        "droop_error_by_pattern": factors,
        "p_error_percent": max(abs(v) for v in p),
        "scale_error_percent": 100 * (m["scale"] / g["scale"] - 1),
        "mirror_reflectivity": dict(zip("RGB", m.get("mirror_reflectivity", []))),
        "polarisation_error": residuals["a_V against the half vector, rms"],
        "polarisation_lights": residuals["polarisation measured"],
    }


def run(build, folder, size):
    """(file, numbers): measured beside given."""
    began = time.monotonic()
    measured, report = measure(build, folder, size)
    numbers = compare(measured, os.path.join(folder, "calibration.json"), report)
    return measured, {"calibrate_seconds": time.monotonic() - began, **numbers}
