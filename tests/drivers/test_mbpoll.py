#!/usr/bin/python3 -B
"""Type the transcript of drivers/modbus/README.md at a simulated controller and compare.

usage: test_mbpoll.py SERVER README     speaks TAP
"""
import fnmatch
import re
import shlex
import shutil
import subprocess
import sys


def transcript(text):
    """[(command, [expected line, ...]), ...] of every ```console block."""
    steps = []
    for block in re.findall(r"```console\n(.*?)```", text, re.S):
        for line in block.splitlines():
            if line.startswith("$ "):
                steps.append((line[2:], []))
            else:
                steps[-1][1].append(line)
    return steps


def matches(expected, line):
    pattern = re.sub(r"[\[\]*?]", lambda m: f"[{m.group()}]" if m.group() != "]" else "]", expected)
    return fnmatch.fnmatchcase(line, pattern.replace("...", "*"))


def missing(expected, printed):
    """The first expected line that is not printed, in order; None if all are."""
    lines = iter(" ".join(line.split()) for line in printed.splitlines())
    for want in expected:
        if not any(matches(want, line) for line in lines):
            return want
    return None


def main(server, readme):
    steps = transcript(open(readme, encoding="utf-8").read())
    if not shutil.which("mbpoll"):
        print("1..0 # SKIP mbpoll is not installed (apt-get install mbpoll)")
        return
    print(f"1..{len(steps) + 1}")
    dome = subprocess.Popen([server], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    port = dome.stdout.readline().strip()
    for number, (command, expected) in enumerate(steps, 1):
        words = [port if word == "1502" else word for word in shlex.split(command)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
        lost = missing(expected, done.stdout + done.stderr)
        print("ok" if lost is None else "not ok", number, command.replace("#", ""))
        if lost is not None:
            print(f"# expected: {lost}")
            print("# " + (done.stdout + done.stderr).replace("\n", "\n# "))
    dome.stdin.close()
    pulses = dome.stdout.read().split("\n")
    good = pulses[0] == "0 0 2000" and pulses[1:] == [""] and dome.wait() == 0
    print("ok" if good else f"not ok", len(steps) + 1, "the dome flashed once for 2000 us")
    if not good:
        print("#", pulses)


main(*sys.argv[1:])
