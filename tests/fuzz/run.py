#!/usr/bin/python3 -B
"""Give targets of this folder bytes: their corpus, and what libFuzzer makes of it in some seconds.

usage: run.py BUILD_ROOT [TARGET...] [--seconds S] [--keep FOLDER]

  --seconds  of each target, default 600
  --keep     a folder for what is found and for the grown corpora, which the next run begins with
"""
import argparse
import glob
import os
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
DATA = os.environ.get("LS_SHARED_DATA") or os.path.join(HERE, "..", "..", "..", "shared", "data")
# Seeds of others, read where they lie.
OTHERS = {"exr": ["openexr/Damaged", "openexr/TestImages", "openexr/DisplayWindow",
                  "openexr/LuminanceChroma"]}
# An input may take 25 s, on a busy machine, and no allocation of it more than 128 MB: the largest limit that a target
# gives a reader is 32 MB, and an array may double while it grows.
LIMITS = ["-timeout=25", "-rss_limit_mb=2048", "-malloc_limit_mb=128", "-max_len=65536"]


def targets(build):
    found = glob.glob(os.path.join(build, "tests", "fuzz", "fuzz_*"))
    return sorted(os.path.basename(path)[5:] for path in found if os.access(path, os.X_OK)
                  and os.path.isfile(path))


def fuzz(build, name, seconds, folder):
    """True if nothing was found. Refused input with its sentence is what these targets expect."""
    grown = os.path.join(folder, name)
    os.makedirs(grown, exist_ok=True)
    seeds = [os.path.join(HERE, "corpus", name),
             *filter(os.path.isdir, (os.path.join(DATA, other) for other in OTHERS.get(name, [])))]
    words = os.path.join(HERE, "words", name)
    command = [os.path.join(build, "tests", "fuzz", "fuzz_" + name), *LIMITS,
               f"-max_total_time={seconds}", f"-artifact_prefix={folder}/{name}-",
               "-print_final_stats=1", *([f"-dict={words}"] if os.path.exists(words) else []),
               grown, *seeds]
    with open(os.path.join(folder, name + ".log"), "w+", encoding="utf-8",
              errors="replace") as log:
        code = subprocess.run(command, stdout=log, stderr=log, check=False, env={
            **os.environ, "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1"}).returncode
        log.seek(0)
        lines = log.read().splitlines()
    executed = [line.split()[-1] for line in lines if "number_of_executed_units" in line]
    print(f"{'ok' if code == 0 else 'not ok'} - {name}: {executed[0] if executed else 0} inputs",
          flush=True)
    for line in lines[-60:] if code else []:
        print(f"# {line}")
    return code == 0


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("build")
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--keep")
    given = parser.parse_args()
    names = given.targets or targets(given.build)
    print(f"1..{len(names)}", flush=True)
    with tempfile.TemporaryDirectory(prefix="ls-fuzz-") as scratch:
        folder = os.path.abspath(given.keep or scratch)
        os.makedirs(folder, exist_ok=True)
        good = [fuzz(given.build, name, given.seconds, folder) for name in names]
    return 0 if good and all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
