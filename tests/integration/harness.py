"""Integration tests in verbs: a folder, a simulated rig, takes, and TAP at the end.

A test is a function whose name is a sentence that is true; it gets a folder of its own. Each file
ends with harness.main(globals()).
"""
import json
import os
import shutil
import sys
import tempfile
import time
import traceback

ROOT = os.environ.get("LS_SOURCE_ROOT") or os.path.abspath(
    os.path.join(os.path.dirname(__file__), "..", ".."))
BUILD = os.environ.get("LS_BUILD_ROOT") or os.path.join(ROOT, "build")
DATA = os.environ.get("LS_SHARED_DATA") or os.path.join(ROOT, "..", "shared", "data")
sys.path[:0] = [os.path.join(ROOT, "sim"), os.path.join(BUILD, "clients", "python")]

import rig as stage  # noqa: E402

Failed = stage.Failed
SANITIZED = bool(os.environ.get("LS_DAEMON"))  # tests/run tsan
ILL_HOST = os.path.join(BUILD, "tests", "integration", "libill_host.so")
PLAN = """subject = "still";
exposures_us = [500, 2500, 12500];
darks = 8;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B"]; },
               { kind = "each"; channels = ["W"]; order = "given"; } );
"""


STANDING = []  # rigs of the test that runs: whatever it does, they are ended after it


class Skip(Exception):
    pass


def data(*names):
    path = os.path.join(DATA, *names)
    if not os.path.exists(path):
        raise Skip(f"measured data absent: {path}")
    return path


def need(program):
    path = shutil.which(program)
    if not path:
        raise Skip(f"{program} is not installed")
    return path


def rig_of(folder, **options):
    """Any rig, not started."""
    if options.get("wire") == "usb" and SANITIZED:
        raise Skip("a sanitizer's daemon does not see what is preloaded for USB")
    STANDING.append(stage.Rig(BUILD, folder, **options))
    return STANDING[-1]


def twelve(folder, faults="", **options):
    """A rig of twelve lights and a camera of 128 x 128, not started."""
    options.setdefault("scene_extra", "lights = 12;")
    options.setdefault("size", 128)
    simulator = options.pop("simulator_extra", "")
    if faults:
        simulator += f"faults = ( {faults} );"
    return rig_of(folder, simulator_extra=simulator, **options)


def wait_for(sentence, true, seconds=60):
    """Poll until true() holds. What is waited for has no event of its own to wait on."""
    limit = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < limit, f"not within {seconds} s: {sentence}"
        time.sleep(0.02)


def refuses(sentence, act, code=None):
    """act() must fail with a sentence that holds these words."""
    try:
        act()
    except Failed as failed:
        assert sentence in str(failed), f"\"{failed}\" does not say \"{sentence}\""
        assert code is None or failed.code == code, f"exit code {failed.code}, expected {code}"
        return
    raise AssertionError(f"not refused: expected \"{sentence}\"")


def shown(rig, fate="sent"):
    """The simulator's log: what was truly shown."""
    lines = stage.read(rig.path("shown.jsonl")).splitlines()
    return [e for e in map(json.loads, lines) if e["fate"] == fate]


def work_light(rig):
    """Is it on? By the simulator's own word: to ask the controller would be a sign of life to it."""
    told = [l for l in stage.read(rig.path("sim.log")).splitlines() if ": work light: " in l]
    return bool(told) and not told[-1].endswith(": off")


def journal(rig, take):
    """The journal's records."""
    text = stage.read(rig.path(os.path.join("takes", take, "journal")))
    return [json.loads(line[9:]) for line in text.splitlines()]


def run(name, test, number):
    folder = tempfile.mkdtemp(prefix="ls-")
    began = time.monotonic()
    try:
        test(folder)
        complaints = [c for rig in STANDING for c in rig.stop()]
        assert not complaints, complaints
        print(f"ok {number} - {name} # {time.monotonic() - began:.1f} s".replace(" # ", " - "))
        return True
    except Skip as skip:
        print(f"ok {number} - {name} # SKIP {skip}")
        return True
    except Exception:  # whatever it is, it is a failed test and the others go on
        for line in traceback.format_exc().splitlines():
            print(f"# {line}")
        for log in ("sim.log", "daemon.log"):
            path = os.path.join(folder, log)
            for line in stage.read(path).splitlines()[-20:] if os.path.exists(path) else []:
                print(f"# {log}: {line}")
        print(f"not ok {number} - {name}")
        return False
    finally:
        for rig in STANDING:
            rig.stop()
        STANDING.clear()
        sys.stdout.flush()
        shutil.rmtree(folder, ignore_errors=True)


def main(names):
    tests = [(n[5:].replace("_", " "), f) for n, f in names.items() if n.startswith("test_")]
    chosen = [t for t in tests if len(sys.argv) < 2 or sys.argv[1].replace("_", " ") in t[0]]
    print(f"1..{len(chosen)}", flush=True)
    good = [run(name, test, number) for number, (name, test) in enumerate(chosen, 1)]
    sys.exit(0 if all(good) else 1)
