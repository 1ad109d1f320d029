#!/usr/bin/python3 -B
"""Photograph, promote, relight and judge a still life on a simulated dome.

usage: sim/demo [--size N] [--keep] [--json FILE]

  --size N     camera of N x N pixels (default 512)
  --keep       keep the folder with the take, the pictures and the logs, and print its name
  --json FILE  write the numbers as JSON

Builds lightstaged, starts the simulated dome and the daemon in a temporary folder, takes 346 lights
in white, full spheres of all 8 channels and darks at three exposures each, relights the take with
sim/environment.json, compares everything with the simulator's truth, and prints a table. Exit
status 0 only if every number holds. Nothing is left running.
"""
import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
BUILD = os.path.join(ROOT, "build")
STOP_SECONDS = 30
SENSOR_MM = 11.26
CHANNELS = "WRAGCBVH"

PLAN = """subject = "still";
exposures_us = [500, 2500, 12500];
darks = 64;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B", "V", "H"]; },
               { kind = "each"; channels = ["W"]; } );
"""


def say(text):
    print(f"== {text}", flush=True)


class Failed(Exception):
    pass


def run(*command, quiet=False):
    done = subprocess.run(command, capture_output=quiet, text=True)
    if done.returncode:
        raise Failed(f"{os.path.basename(command[0])} exited with {done.returncode}"
                     + (f": {done.stderr.strip()}" if quiet else ""))
    return done.stdout


def die_with_parent():
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


class Process:
    """A child that says when it is ready, with its output in a log."""

    def __init__(self, log, *command):
        read, write = os.pipe()
        self.name = os.path.basename(command[0])
        self.log = log
        with open(log, "w", encoding="utf-8") as out:
            self.child = subprocess.Popen([*command, "--ready-fd", str(write)], stdout=out,
                                          stderr=out, stdin=subprocess.DEVNULL, pass_fds=[write],
                                          preexec_fn=die_with_parent)
        os.close(write)
        with os.fdopen(read, encoding="utf-8") as pipe:
            line = pipe.readline()
        if not line:
            self.child.wait(STOP_SECONDS)
            raise Failed(f"{self.name} did not start:\n{open(log, encoding='utf-8').read()}")
        self.ready = json.loads(line)

    def stop(self):
        if self.child.poll() is None:
            self.child.terminate()
        try:
            code = self.child.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
            return f"{self.name} did not end within {STOP_SECONDS} s of SIGTERM"
        return f"{self.name} ended with {code}" if code else None


def build():
    say("building")
    if not os.path.exists(os.path.join(BUILD, "build.ninja")):
        run("meson", "setup", BUILD, ROOT, quiet=True)
    run("ninja", "-C", BUILD, "--quiet")


def program(path):
    return os.path.join(BUILD, path)


def write(path, text):
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def address():
    """A loopback address of this run's own, so that runs side by side do not collide."""
    pid = os.getpid()
    return f"127.{64 + pid // 250 % 128}.{1 + pid % 250}.1"


def write_simulator(folder, size, camera):
    write(os.path.join(folder, "sim.conf"), f"""
scene = {{ name = "stilllife"; seed = 1; }};
cameras = ( {{ address = "{camera}"; width = {size}; height = {size}; cfa = "RG"; }} );
controller = {{ port = 0; }};
log = "shown.jsonl";
""")


def write_daemon(folder, size, camera, port, constants):
    write(os.path.join(folder, "daemon.conf"), f"""
storage = "takes";
socket = "socket";
rig = "rig.conf";
calibration = "calibration.json";
controller = {{ driver = "modbus"; address = "127.0.0.1"; port = {port}; timeout_ms = 2000; }};
""")
    channels = ", ".join('{ name = "%s"; kind = "%s"; }' %
                         (c, "polariser" if c in "VH" else "spectrum") for c in CHANNELS)
    write(os.path.join(folder, "rig.conf"), f"""
name = "simulated dome";
lights = {{ positions = "positions.csv"; axes = "right,up,towards"; unit = "m"; }};
channels = ( {channels} );
cameras = ( {{ name = "front"; address = "{camera}"; width = {size}; height = {size};
    pixel_format = "{constants['pixel_format']}"; packet_size = 9000; max_fps = 72;
    position_m = [0.0, 0.0, 1.6]; look_at_m = [0.0, 0.0, 0.0]; focal_length_mm = 50;
    sensor_mm = [{SENSOR_MM}, {SENSOR_MM}]; range = [0.10, 0.85];
    black_dn = {constants['black_dn']}; full_scale_dn = {constants['full_scale_dn']};
    electrons_per_dn = {constants['electrons_per_dn']};
    read_noise_dn = {constants['read_noise_dn']};
    exposure_offset_us = {constants['exposure_offset_us']}; }} );
""")


def control(folder, *arguments, **options):
    return run(program("clients/lightstagectl"), "--socket", os.path.join(folder, "socket"),
               *arguments, **options)


def photograph(folder):
    write(os.path.join(folder, "plan.conf"), PLAN)
    say("taking: 346 lights in white, 8 full spheres, darks, three exposures each")
    began = time.monotonic()
    control(folder, "take", "start", "--name", "demo", "--plan", os.path.join(folder, "plan.conf"))
    seconds = time.monotonic() - began
    takes = json.loads(control(folder, "take", "list", "--json", quiet=True))["takes"]
    say("verifying every checksum")
    control(folder, "take", "verify", takes[-1]["id"])
    return takes[-1]["id"], seconds


def relight(folder, take, name, *options):
    began = time.monotonic()
    control(folder, "relight", take, os.path.join(ROOT, "sim", "environment.json"), "--raw",
            "--output", os.path.join(folder, name + ".exr"),
            "--png", os.path.join(folder, name + ".png"), *options)
    return time.monotonic() - began


def judge(folder, take):
    say("judging against the simulator's truth")
    return json.loads(run(
        program("tests/lightstage-judge"), "--simulator", os.path.join(folder, "sim.conf"),
        "--take", os.path.join(folder, "takes", take), "--log", os.path.join(folder, "shown.jsonl"),
        "--environment", os.path.join(ROOT, "sim", "environment.json"),
        "--relit", os.path.join(folder, "multispectral.exr"),
        "--tristimulus", os.path.join(folder, "tristimulus.exr"),
        "--sheet", os.path.join(folder, "contact-sheet.png"), quiet=True))


def holds(r):
    """What must be true, as (sentence, is it)."""
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


def demo(folder, size):
    camera = address()
    write_simulator(folder, size, camera)
    run(program("sim/lightstage-sim"), "describe", "--config", os.path.join(folder, "sim.conf"),
        "--output", folder)
    with open(os.path.join(folder, "calibration.json"), encoding="utf-8") as file:
        constants = json.load(file)["camera"]
    say(f"starting the simulated dome and its camera at {camera}")
    dome = Process(os.path.join(folder, "sim.log"), program("sim/lightstage-sim"), "run",
                   "--config", os.path.join(folder, "sim.conf"))
    daemon = None
    try:
        write_daemon(folder, size, camera, dome.ready["modbus_port"], constants)
        say("starting the daemon")
        daemon = Process(os.path.join(folder, "daemon.log"), program("daemon/lightstaged"),
                         "--config", os.path.join(folder, "daemon.conf"))
        take, seconds = photograph(folder)
        say("relighting")
        relight_seconds = relight(folder, take, "multispectral")
        relight(folder, take, "tristimulus", "--solve", "tristimulus")
    finally:
        ended = [p.stop() for p in (daemon, dome) if p]
    if any(ended):
        raise Failed("; ".join(e for e in ended if e))
    result = judge(folder, take)
    result["take_wall_seconds"] = seconds
    result["relight_seconds"] = relight_seconds
    return result


def parse():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n")[0])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--json")
    options = parser.parse_args()
    if not 64 <= options.size <= 4096 or options.size % 2:
        parser.error("--size: expected an even number from 64 to 4096")
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
        result = demo(folder, options.size)
        wrong = [sentence for sentence, true in holds(result) if not true]
        result["verdict"] = "failed" if wrong else "ok"
        table(result)
        if options.json:
            write(options.json, json.dumps(result, indent=1) + "\n")
        for sentence in wrong:
            print(f"DOES NOT HOLD: {sentence}")
        print(f"verdict: {result['verdict']}")
        return 1 if wrong else 0
    except (Failed, OSError, KeyError, ValueError) as error:
        print(f"{error}\nverdict: failed", file=sys.stderr)
        return 1
    finally:
        if options.keep:
            print(f"kept: {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
