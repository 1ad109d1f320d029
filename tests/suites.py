#!/usr/bin/python3 -B
"""Build lightstaged and run its tests.

usage: tests/run [SUITE]       (tests/run installs what is missing, then starts this program)

  (none)    everything a developer wants before a commit: unit and integration tests, layer check
  ci        the same with gcc, and the unit tests with clang under ASan and UBSan, where long
            calculations are brief; warnings are errors
  full      also the long variants of the random tests
  sanitize  unit tests under AddressSanitizer and UndefinedBehaviorSanitizer
  tsan      the daemon's unit tests under ThreadSanitizer, and the integration tests with a daemon
            under it
  leaks     1,000 takes and 10,000 connections leave nothing: tests/run leaks [--takes N]
            [--connects N]
  rate      takes at the cameras' full rate, on an idle machine; --quick: 100 conditions each;
            --clients: one of them, alone and while clients pull pictures
  fuzz      targets of tests/fuzz, 10 minutes each: tests/run fuzz [TARGET...] [--seconds S] [--keep D]
  soak      200 short takes under random mixtures of faults: tests/run soak [--takes N] [--seed S]
"""
import json
import os
import shutil
import signal
import subprocess
import sys
import xml.etree.ElementTree as xml

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SOAK = os.path.join(ROOT, "tests", "integration", "soak.py")
LEAKS = os.path.join(ROOT, "tests", "integration", "leaks.py")
FUZZ = os.path.join(ROOT, "tests", "fuzz", "run.py")
NOT_BUILT = 125  # meson test's exit code where its build fails
CORES = len(os.sched_getaffinity(0))
UNITS = ["--no-suite=integration"]
# takes keep a third of a core busy; the rest of the time they wait for exposures and timeouts
INTEGRATION = ["--suite=integration", f"--num-processes={2 * CORES}"]
INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SANITIZE = ["-Db_sanitize=address,undefined", "-Db_lundef=false"]


def say(text):
    print(f"== {text}", flush=True)


def call(*command, env=None):
    with subprocess.Popen(command, cwd=ROOT, env={**os.environ, **(env or {})},
                          start_new_session=True) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            # on SIGTERM meson ends the processes of every test, on SIGINT of one only
            for number in INTERRUPTS:
                signal.signal(number, signal.SIG_IGN)
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()
            raise


def build(name, options=(), cc="gcc", whole=True):
    """Configure a tree and build all of it; its folder, or None. What else a selection of tests
    needs is built by meson test."""
    folder = os.path.join(ROOT, name)
    say(f"building with {cc} into {name} {' '.join(options)}".rstrip())
    if not shutil.which(cc):
        say(f"{cc} is not installed")
        return None
    if not os.path.exists(os.path.join(folder, "build.ninja")):
        # an interrupted reconfiguration leaves all but build.ninja
        known = os.path.exists(os.path.join(folder, "meson-private", "coredata.dat"))
        again = ["--reconfigure"] if known else []
        if call("meson", "setup", *again, folder, ROOT, *options, env={"CC": cc}):
            return None
    return None if whole and call("ninja", "-C", folder, "--quiet") else folder


def junit(folder):
    return os.path.join(folder, "meson-logs", "testlog.junit.xml")


def forget(folder):
    """The last run's results."""
    for log in (junit(folder), os.path.join(folder, "meson-logs", "testlog.json")):
        if os.path.exists(log):
            os.remove(log)


def count(folder):
    """(passed, failed, skipped, names of the failed) of the last meson test run in folder."""
    passed = skipped = 0
    names = []
    for suite in xml.parse(junit(folder)).getroot().iter("testsuite"):
        for case in suite.iter("testcase"):
            if case.find("failure") is not None or case.find("error") is not None:
                names.append(f"{suite.get('name')} {case.get('name')}")
            elif case.find("skipped") is not None:
                skipped += 1
            else:
                passed += 1
    # a program that died or ran too long names no test that failed: it counts itself
    with open(os.path.join(folder, "meson-logs", "testlog.json"), encoding="utf-8") as log:
        for program in map(json.loads, log):
            name = program["name"]
            if program["result"] not in ("OK", "SKIP", "EXPECTEDFAIL", "INTERRUPT") and not any(
                    failed.startswith(f"lightstaged.{name} ") for failed in names):
                names.append(f"lightstaged.{name} {program['result']}")
    return passed, len(names), skipped, names


def meson_run(folder, arguments, env):
    """One run of meson test; what count() says of it."""
    forget(folder)
    code = call("meson", "test", "-C", folder, "--print-errorlogs",
                "--timeout-multiplier=4", *arguments, env=env)
    if code == NOT_BUILT:
        return 0, 1, 0, [f"{os.path.basename(folder)} does not build"]
    if not os.path.exists(junit(folder)):
        return 0, 1, 0, [f"no test ran in {folder}"]
    result = count(folder)
    if code and not result[1]:
        result = (result[0], 1, result[2], [f"meson test exited with {code}"])
    return result


def failing_programs(folder):
    """Names of the programs of the last run that did not succeed."""
    with open(os.path.join(folder, "meson-logs", "testlog.json"), encoding="utf-8") as log:
        return sorted({p["name"].split(" / ")[-1] for p in map(json.loads, log)
                       if p["result"] not in ("OK", "SKIP", "EXPECTEDFAIL")})


def meson_test(folder, selection, env=None):
    """All tests; a program that fails is run once more, alone, and both outcomes are shown: these
    tests drive clocks, sockets and six processes, and a machine may stop for a second."""
    first = meson_run(folder, selection, env)
    if not first[1] or not os.path.exists(os.path.join(folder, "meson-logs", "testlog.json")):
        return first
    again = failing_programs(folder)
    if not again or len(again) > 3:
        return first
    say(f"failed, once more alone: {', '.join(again)}")
    second = meson_run(folder, [*again, "--num-processes=1"], env)
    for name in first[3]:
        print(f"{'FAILED TWICE' if second[1] else 'FAILED ONCE'} {name}")
    return (first[0] + (0 if second[1] else first[1]), second[1], first[2], second[3])


def run_job(name, options, cc, whole, selection, own, env):
    """Build a tree and run a selection of its tests, own being their environment beside every
    job's env; as count()."""
    forget(os.path.join(ROOT, name))
    folder = build(name, options, cc, whole)
    if not folder:
        return 0, 1, 0, [f"{name} does not build"]
    say(f"testing {name} {' '.join(selection)}")
    return meson_test(folder, selection, {**env, **own})


def soak(arguments):
    folder = build("build")
    return 2 if not folder else call("/usr/bin/python3", "-B", SOAK, *arguments,
                                     env={"LS_SOURCE_ROOT": ROOT, "LS_BUILD_ROOT": folder})


def leaks(arguments):
    folder = build("build")
    return 2 if not folder else call("/usr/bin/python3", "-B", LEAKS, *arguments,
                                     env={"LS_SOURCE_ROOT": ROOT, "LS_BUILD_ROOT": folder})


def fuzz(arguments):
    folder = build("build-sanitize", SANITIZE, "clang", whole=False)
    if not folder or call("ninja", "-C", folder, "--quiet", "fuzz"):
        return 2
    return call("/usr/bin/python3", "-B", FUZZ, folder, *arguments)


def rate(arguments):
    folder = build("build")
    if not folder:
        return 1
    return call(sys.executable, "-B", os.path.join("tests", "bench", "rate.py"), "--build", folder,
                *arguments)


def main():
    for number in INTERRUPTS:
        signal.signal(number, signal.default_int_handler)
    runs = {"soak": soak, "rate": rate, "fuzz": fuzz, "leaks": leaks}
    if sys.argv[1:] and sys.argv[1] in runs:
        try:
            return runs[sys.argv[1]](sys.argv[2:])
        except KeyboardInterrupt:
            say("interrupted")
            return 130
    suite = sys.argv[1] if len(sys.argv) > 1 else "default"
    if suite in ("-h", "--help"):
        print(__doc__)
        return 0
    if suite not in ("default", "ci", "full", "sanitize", "tsan"):
        print(f"there is no suite \"{suite}\"; tests/run --help lists them", file=sys.stderr)
        return 2
    data = os.environ.get("LS_SHARED_DATA", os.path.join(ROOT, "..", "shared", "data"))
    env = {"LS_SHARED_DATA": os.path.abspath(data)}
    if suite == "full":
        env["LS_TEST_FULL"] = "1"
    strict = ["--werror"] if suite == "ci" else []
    brief = {"LS_TEST_BRIEF": "1"} if suite == "ci" else {}
    jobs = []
    if suite == "tsan":
        jobs.append(("build-tsan", ["-Db_sanitize=thread", "-Db_lundef=false"], "clang",
                     False, ["--suite=daemon"], {}))
        # programs that follow their daemon's clock are as fast as ever
        jobs.append(("build", [], "gcc", True, INTEGRATION, {"LS_DAEMON": os.path.join(
            ROOT, "build-tsan", "tests", "lightstaged-tsan")}))
        env["TSAN_OPTIONS"] = "halt_on_error=0"
    elif suite != "sanitize":
        name = "build" if suite != "ci" else "build-ci"
        jobs += [(name, strict, "gcc", True, tests, {}) for tests in (UNITS, INTEGRATION)]
    if suite in ("ci", "sanitize"):
        jobs.append(("build-sanitize", SANITIZE + strict, "clang", False,
                     [*UNITS, "--no-suite=bench", "--no-suite=layers"], brief))
        # the USB tests run under umockdev's preload library, which comes first
        env["ASAN_OPTIONS"] = "detect_leaks=1:verify_asan_link_order=0"
        env["UBSAN_OPTIONS"] = "halt_on_error=1:print_stacktrace=1"
    results = []
    interrupted = False
    try:
        for job in jobs:
            results.append(run_job(*job, env))
    except KeyboardInterrupt:
        interrupted = True
        say("interrupted: what had not ended is not counted")
        folder = os.path.join(ROOT, jobs[len(results)][0])
        results += [count(folder)] if os.path.exists(junit(folder)) else []
    total = [sum(column) for column in list(zip(*results))[:3]] or [0, 0, 0]
    for name in (name for result in results for name in result[3]):
        print(f"FAILED {name}")
    print(f"{total[0]} passed, {total[1]} failed" + (f", {total[2]} skipped" if total[2] else ""))
    return 130 if interrupted else 1 if total[1] or not total[0] else 0


if __name__ == "__main__":
    sys.exit(main())
