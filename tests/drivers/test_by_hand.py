#!/usr/bin/python3 -B
"""Run the Python examples of a wire's README against a simulated controller on that wire.

usage: test_by_hand.py SERVER README WIRE MODULE PULSE     speaks TAP
WIRE is as dome_server calls it, MODULE what the examples need, PULSE the one line the dome must
have said of its flashes.
"""
import doctest
import importlib.util
import os
import re
import subprocess
import sys

PRELOAD = {"LD_PRELOAD": "libumockdev-preload.so.0"}


def examples(readme, line):
    """Run every block in one namespace; the exit code counts those that printed something else."""
    text = open(readme, encoding="utf-8").read()
    names, wrong, out = {"LINE": line}, 0, sys.stdout  # run() puts its own there
    blocks = re.findall(r"```pycon\n(.*?)```", text, re.S)
    runner = doctest.DocTestRunner(optionflags=doctest.REPORT_ONLY_FIRST_FAILURE)
    for number, block in enumerate(blocks, 1):
        test = doctest.DocTestParser().get_doctest(block, names, readme, readme, 0)
        failed = runner.run(test, out=lambda said: out.write("# " + said.replace("\n", "\n# ")),
                            clear_globs=False).failed
        names = test.globs
        wrong += bool(failed)
        first = block.strip().split("\n")[0].lstrip("> ")
        print("\nnot ok" if failed else "ok", number, first.replace("#", ""), flush=True)
    return wrong


def main(server, readme, wire, module, pulse):
    if importlib.util.find_spec(module) is None:
        print(f"1..0 # SKIP python has no module {module}")
        return
    blocks = len(re.findall("```pycon", open(readme, encoding="utf-8").read()))
    print(f"1..{blocks + 1}", flush=True)
    usb = PRELOAD if wire == "usb" else {}
    dome = subprocess.Popen([server, wire], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                            text=True, env={**os.environ, **usb})
    path = dome.stdout.readline().strip()
    testbed = {"UMOCKDEV_DIR": path} if usb else {}
    subprocess.run([sys.executable, "-B", __file__, "--examples", readme, path], timeout=60,
                   env={**os.environ, **usb, **testbed}, check=False)
    dome.stdin.close()
    pulses = dome.stdout.read().split("\n")
    good = pulses == [pulse, ""] and dome.wait() == 0
    print("ok" if good else "not ok", blocks + 1, "the dome flashed once:", pulse)
    if not good:
        print("#", pulses)


if sys.argv[1] == "--examples":
    sys.exit(examples(*sys.argv[2:]))
main(*sys.argv[1:])
