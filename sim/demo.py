#!/usr/bin/python3 -B
"""Photograph, promote, relight and judge a still life on a simulated dome.

usage: sim/demo [--size N] [--spread S] [--calibrate] [--keep] [--json FILE]

  --size N     camera of N x N pixels (default 512)
  --spread S   relative spread of the LEDs' strengths, 0 to 0.2 (default 0.05)
  --calibrate  measure the calibration first, on a grey, a chrome and a black glossy sphere, and
               print it beside the given one
  --keep       keep the folder with the take, the pictures and the logs, and print its name
  --json FILE  write the numbers as JSON

Builds lightstaged, starts the simulated dome and the daemon in a temporary folder, takes 346 lights
in white, full spheres of all 8 channels and darks at three exposures each, relights the take with
sim/environment.json, compares everything with the simulator's truth, and prints a table. Exit
status 0 only if every number holds. Nothing is left running.
"""
import argparse
import json
import math
import os
import shutil
import signal
import sys
import tempfile
import time

import calibrate
import rig as stage
from rig import say

BUILD = os.environ.get("LS_BUILD_ROOT") or os.path.join(stage.ROOT, "build")
PROGRAMS = ["sim/lightstage-sim", "daemon/lightstaged", "clients/lightstagectl",
            "tests/lightstage-judge"]
ENVIRONMENT = os.path.join(stage.ROOT, "sim", "environment.json")
# Sigma of a point's image in photosites: the aperture of a photosite 0.29, a good lens 0.4, and an
# optical low-pass filter that splits a point by half a photosite either way, 0.5; added in squares.
BLUR_PX = 0.7

LEAST_CALIBRATED_SIZE = 256

PLAN = """subject = "still";
exposures_us = [100, 800, 6400];
darks = 64;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B", "V", "H"]; },
               { kind = "each"; channels = ["W"]; } );
"""


KEYS = """lights channels width height shots_planned shots_stored shots_lost shots_repaired
frames_mislabeled take_seconds frames_per_second calibration model promotion_error_percent
promotion_error_by_channel olat_mae_percent field_rms_percent interreflection_rms_percent
highlight_rms_percent relight_error_percent tristimulus_error_percent paper_mse_chart_percent
paper_mse_fabric_percent paper_rms_percent black_mean_sigma relight_seconds""".split()


def build():
    say("building")
    if not os.path.exists(os.path.join(BUILD, "build.ninja")):
        stage.call("meson", "setup", BUILD, stage.ROOT)
    stage.call("ninja", "-C", BUILD, "--quiet", *PROGRAMS, quiet=False)


def relight(rig, take, name, *options):
    began = time.monotonic()
    rig.control("relight", take, ENVIRONMENT, "--raw", "--output", rig.path(name + ".exr"),
                "--png", rig.path(name + ".png"), *options)
    return time.monotonic() - began


def holds(result):
    """What must be true, as (sentence, is it); a number that could not be had makes nothing true."""
    r = {key: math.nan if value is None else value for key, value in result.items()}
    return [
        ("no shot is lost", r["shots_lost"] == 0),
        ("every planned shot is stored", r["shots_stored"] == r["shots_planned"]),
        ("no frame is mislabeled", r["frames_mislabeled"] == 0),
        ("promotion error is at most 1 %", r["promotion_error_percent"] <= 1.0),
        ("relighting beats the tristimulus baseline",
         r["relight_error_percent"] < r["tristimulus_error_percent"]),
        ("black is black: within 3 sigma", abs(r["black_mean_sigma"]) <= 3),
    ]


def table(result):
    for key, value in result.items():
        if isinstance(value, dict):
            value = "  ".join(f"{k} {v:.3f}" for k, v in value.items())
        elif isinstance(value, float):
            value = f"{value:.3f}"
        print(f"  {key:32} {value}")


def demo(folder, size, spread, measure):
    options, numbers, rows = {"scene_extra": f"gain_sigma = {spread};"}, {}, []
    if measure:
        say("calibrating: a grey, a chrome and a black glossy sphere under every light")
        options["calibration"], numbers, rows = calibrate.run(
            BUILD, os.path.join(folder, "calibration"), size, options["scene_extra"])
        print(*calibrate.table(rows), sep="\n", flush=True)
    rig = stage.Rig(BUILD, folder, size, blur_px=BLUR_PX, **options)
    say(f"starting the simulated dome, its camera at {rig.addresses[0]}, and the daemon")
    try:
        rig.start()
        say("taking: 346 lights in white, 8 full spheres, darks, three exposures each")
        take = rig.start_take("demo", PLAN, quiet=False)
        say("verifying every checksum")
        rig.control("take", "verify", take)
        say("relighting, in many spectra and in three")
        relight_seconds = relight(rig, take, "multispectral")
        relight(rig, take, "tristimulus", "--solve", "tristimulus")
    finally:
        wrong = rig.stop()
    if wrong:
        raise stage.Failed("; ".join(wrong))
    say("judging against the simulator's truth")
    result = rig.judge(take, "--environment", ENVIRONMENT,
                       "--relit", rig.path("multispectral.exr"),
                       "--tristimulus", rig.path("tristimulus.exr"),
                       "--sheet", rig.path("contact-sheet.png"))
    result["relight_seconds"] = relight_seconds
    result["calibration"] = "measured" if measure else result["calibration"]
    wrong = [row.name for row in rows if not calibrate.holds(row)]
    wrong += [sentence for sentence, true in holds(result) if not true]
    return {**{key: result[key] for key in KEYS}, **numbers}, wrong


def parse():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n")[0])
    parser.add_argument("--size", type=int, default=calibrate.USUAL_SIZE)
    parser.add_argument("--spread", type=float, default=0.05)
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--json")
    options = parser.parse_args()
    if not 64 <= options.size <= 4096 or options.size % 4:
        parser.error("--size: expected a multiple of 4 from 64 to 4096")
    if not 0 <= options.spread <= 0.2:
        parser.error("--spread: expected 0 to 0.2")
    if options.calibrate and options.size < LEAST_CALIBRATED_SIZE:
        parser.error(f"--calibrate: expected --size {LEAST_CALIBRATED_SIZE} or more: in smaller "
                     "pictures the spheres are too small to measure lights at the side")
    return options


def main():
    if "-h" in sys.argv[1:] or "--help" in sys.argv[1:]:
        print(__doc__)
        return 0
    options = parse()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    folder = tempfile.mkdtemp(prefix="lightstage-")
    try:
        build()
        result, wrong = demo(folder, options.size, options.spread, options.calibrate)
        result["verdict"] = "failed" if wrong else "ok"
        table(result)
        if options.json:
            stage.write(options.json, json.dumps(result, indent=1) + "\n")
        for sentence in wrong:
            print(f"DOES NOT HOLD: {sentence}")
        print(f"verdict: {result['verdict']}")
        return 1 if wrong else 0
    except (stage.Failed, OSError, KeyError, ValueError) as error:
        print(f"{error}\nverdict: failed", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    finally:
        if options.keep:
            print(f"kept: {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
