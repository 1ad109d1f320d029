"""The demo's own calibration: an operator who puts objects on the simulated stage, and the judge who
knows what should have come out."""
import collections
import json
import math
import os
import statistics
import subprocess
import time

import rig as stage

SCENES = ["grey", "chrome", "gloss"]  # in the order lightstagectl calibrate asks for them
PROMPT = b"press Enter: "
PATTERNS = ["sphere", "segments-14", "headlight"]
USUAL_SIZE = 512
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


def measure(build, folder, size, scene_extra):
    """Calibrate a rig of its own; returns the file and what the client reports."""
    os.makedirs(folder)
    side = region(size)
    rig = stage.Rig(build, folder, size, scene=SCENES[0], region=(side, side),
                    scene_extra=scene_extra)
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


# What a person reads: the largest error of its kind, and what it may be. Text but for the last two.
Row = collections.namedtuple("Row", "name given measured unit error limit")


def worst(pairs, name, limit):
    """Of (what, given, measured) the one that is most off, in percent; None of none."""
    what, given, measured = max(pairs, key=lambda pair: abs(pair[2] / pair[1] - 1))
    return Row(f"{name} {what}", f"{given:.5g}", f"{measured:.5g}", "%",
               100 * abs(measured / given - 1), limit)


def factor_pairs(m, g):
    """By pattern, (channel, given, measured) of the duties that both know."""
    given = {(f["channel"], f["pattern"], round(f["duty"], 6)): f["factor"]
             for f in g["pattern_factors"]}
    out = {pattern: [] for pattern in PATTERNS}
    for f in m["pattern_factors"]:
        factor = given.get((f["channel"], f["pattern"], round(f["duty"], 6)))
        if factor and f["pattern"] in out:
            out[f["pattern"]].append((f"in {f['channel']}", factor, f["factor"]))
    return out


def spread(rows, sure):
    """Of the strengths of all channels, in percent."""
    return 100 * rms([statistics.pstdev(1 / k[i] for i in sure) * statistics.fmean(k[i] for i in sure)
                      for k in rows.values()])


def bound(size):
    """Of what is relative to the mean of all lights, in percent. A gain's noise goes with one over the
    sphere's radius in pixels (0.07, 0.14 and 0.29 % rms at 512, 256 and 128), that of a mean with
    crescents in it too, and in pictures smaller than the usual ones so does the bound."""
    return 0.5 * max(1, USUAL_SIZE / size)


def gain_rows(m, g, sure, residuals, size):
    common = {s: residuals[f"of that, common to all lights of {s}"] / 100 for s in g["k"]}
    honesty = {s: honest(m, g, s, sure, common[s]) for s in g["k"]}
    within = statistics.fmean(w for w, _ in honesty.values())
    apart = max(abs(z) for _, z in honesty.values())
    pairs = [(f"of light {i} in {s}", g["k"][s][i], m["k"][s][i]) for s in g["k"] for i in sure]
    off = rms([100 * (b / a - 1) for _, a, b in pairs])
    top = worst(pairs, "k", bound(size))
    numbers = {"k_lights": len(sure), "k_error_percent": off, "k_worst_percent": top.error,
               "k_within_sigma_percent": within,
               "k_within_sigma_by_channel": {s: w for s, (w, _) in honesty.items()},
               "k_common_error_sigma": apart}
    return numbers, [
        Row(f"k of {len(sure)} lights (their spread), rms", f"{spread(g['k'], sure):.2f} %",
            f"{spread(m['k'], sure):.2f} %", "%", off, None),
        top,
        Row("gains within their own sigma", "68 %", f"{within:.1f} %", "%", abs(within - 68), 7),
        Row("what all gains of a channel have in common", "0", "", "sigma", apart, 3),
    ]


def direction_rows(m, g, sure, residuals):
    off = [angle(m["lights"]["measured_direction"][i], g["lights"]["direction"][i]) for i in sure]
    chrome = residuals["directions by the chrome ball, rms from the rig file"]
    return {"direction_error_deg": rms(off), "direction_worst_deg": max(off),
            "chrome_direction_error_deg": chrome}, [
        Row("directions by shading, worst", "rig file", "", "deg", max(off), 0.5),
        Row("directions by the chrome ball, rms", "rig file", "", "deg", chrome, 2),
    ]


def factor_rows(m, g):
    pairs = factor_pairs(m, g)
    rows = {pattern: worst(pairs[pattern] or [("compared", math.nan, math.nan)],
                           f"factor of {pattern}", 0.5) for pattern in PATTERNS}
    errors = {pattern: row.error for pattern, row in rows.items()}
    return {"droop_error_percent": max(errors.values()),
            "droop_error_by_pattern": errors}, list(rows.values())


def scale_rows(m, g, size):
    """Ratios of two channels' levels, each of a light of the mean strength."""
    p = worst([(f"of {c} in {s}", a, b) for s in g["p"]
               for c, a, b in zip("RGB", g["p"][s], m["p"][s])], "p", bound(size))
    scale = worst([("", g["scale"], m["scale"])], "scale", bound(size))
    return {"p_error_percent": p.error, "scale_error_percent": scale.error}, [p, scale]


def probe_rows(m, g, residuals):
    """A rough metal throws a hundredth of its light beyond what is taken for its highlight."""
    mirror = m.get("mirror_reflectivity", [math.nan] * 3)
    a = residuals["a_V against the half vector, rms"]
    numbers = {"mirror_reflectivity": dict(zip("RGB", mirror)), "polarisation_error": a,
               "polarisation_lights": residuals["polarisation measured"]}
    return numbers, [
        worst(list(zip("RGB", g["mirror_reflectivity"], mirror)), "mirror reflectivity in", 2),
        Row(f"a_V of {residuals['polarisation measured']:.0f} lights, rms", "half vector", "", "",
            a, 0.02),
    ]


def residual_rows(residuals):
    """What the measurement says of itself."""
    names = (("grey sphere from the centre", "mm", 0.2),
             ("shading, rms of the middle light", "%", 5),
             ("pixels off the shading", "%", 1),
             ("lights beside their places", "deg", 0.1),
             ("chrome ball against shading, rms", "deg", 2))
    return [Row("residual: " + name, "", "", unit, residuals[name], limit)
            for name, unit, limit in names]


def compare(measured, given, report, size):
    """How far the measured calibration is from the one the simulator gives: the demo's keys, and the
    table's rows. Lights with a flag are left out."""
    m, g = (json.loads(stage.read(path)) for path in (measured, given))
    flagged = {i for lights in m["lights"].get("flags", {}).values() for i in lights}
    sure = [i for i in range(len(g["k"]["W"])) if i not in flagged]
    residuals = report["residuals"]
    numbers, rows = {}, []
    for part in (gain_rows(m, g, sure, residuals, size), direction_rows(m, g, sure, residuals),
                 factor_rows(m, g), scale_rows(m, g, size), probe_rows(m, g, residuals)):
        numbers.update(part[0])
        rows += part[1]
    return numbers, rows + residual_rows(residuals)


def holds(row):
    return row.limit is None or row.error <= row.limit


def table(rows):
    """Lines for a person."""
    line = "  {:44} {:>12} {:>12} {:>14} {:>10}  {}".format
    yield line("calibration", "given", "measured", "error", "limit", "").rstrip()
    for row in rows:
        unit = f" {row.unit}".rstrip()
        yield line(row.name, row.given, row.measured, f"{row.error:.3g}{unit}",
                   "" if row.limit is None else f"{row.limit:.2g}{unit}",
                   "" if row.limit is None else "ok" if holds(row) else "DOES NOT HOLD").rstrip()


def run(build, folder, size, scene_extra):
    """(file, numbers, rows): measured beside given."""
    began = time.monotonic()
    measured, report = measure(build, folder, size, scene_extra)
    numbers, rows = compare(measured, os.path.join(folder, "calibration.json"), report, size)
    return measured, {"calibrate_seconds": time.monotonic() - began, **numbers}, rows
