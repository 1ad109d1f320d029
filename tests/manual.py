#!/usr/bin/python3 -B
"""Does the manual name every key, command, option and error there is? And bash complete them?

usage: manual.py SOURCE_ROOT BUILD_ROOT LIGHTSTAGECTL     speaks TAP

Keys are those that the readers of configuration ask for (ls_conf_*), options those of --help.
"""
import os
import re
import subprocess
import sys
import tempfile

ROOT, BUILD, CTL = (os.path.abspath(path) for path in sys.argv[1:4])
# which page has the keys that a file reads; of config.c, the functions that read the daemon's file
PAGES = {"plan": "lightstage-plan.5", "rig": "lightstage-rig.5", "daemon": "lightstaged.conf.5"}
KEY = re.compile(r'(?:ls_conf_(?:need_)?(?:string|word|int|number|numbers|bool|child)|read_(?:ids|names))\(\s*[&\w]+,\s*"(\w+)"')
ENV = {**os.environ, "PATH": os.path.dirname(CTL) + os.pathsep + os.environ["PATH"]}


def read(*path):
    with open(os.path.join(*path), encoding="utf-8") as file:
        return file.read()


def page(name):
    """Its text as a reader sees it, in one line."""
    text = read(BUILD, name)
    return re.sub(r"\\f[BIRP]|\\&", "", text).replace("\\_", "_").replace("\\-", "-")


def keys():
    """(page, key) of every key that is read."""
    daemon = os.path.join(ROOT, "daemon")
    for name in sorted(os.listdir(daemon)):
        if name.endswith(".c") and name.startswith(("plan", "config", "conf_access")):
            for key in KEY.findall(read(daemon, name)):
                yield "plan" if name.startswith("plan") else "config", key


def check_keys():
    found = sorted(set(keys()))
    assert len(found) > 60, f"only {len(found)} keys found: does the pattern still fit?"
    plan = page(PAGES["plan"])
    config = page(PAGES["rig"]) + page(PAGES["daemon"])
    return [f"{where}: no page names {key}" for where, key in found
            if not re.search(rf"\b{key}\b", plan if where == "plan" else config)]


def help_of(*words):
    run = subprocess.run([CTL, *words, "--help"], check=True, capture_output=True, text=True)
    return run.stdout


def commands():
    names = re.findall(r"^  ([a-z]+(?: [a-z]+)?)  ", help_of(), re.MULTILINE)
    assert "take start" in names and "relight" in names, names
    return names


def check_commands():
    text, wrong = page("lightstagectl.1"), []
    for name in commands():
        if name not in text:
            wrong.append(f"lightstagectl.1 does not name {name}")
        for option in sorted(set(re.findall(r"--[a-z][a-z-]*", help_of(*name.split())))):
            if not re.search(re.escape(option) + r"(?![a-z-])", text):
                wrong.append(f"lightstagectl.1 does not name {option} of {name}")
    return wrong


def check_render():
    text = page("lightstage-render.1")
    help_text = subprocess.run([os.path.join(os.path.dirname(CTL), "lightstage-render"), "--help"],
                               check=True, capture_output=True, text=True).stdout
    options = sorted(set(re.findall(r"--[a-z][a-z-]*", help_text)))
    assert len(options) > 25, options
    wrong = [f"lightstage-render.1 does not name {option}" for option in options
             if not re.search(re.escape(option) + r"(?![a-z-])", text)]
    for words, wanted in (("--fr",), {"--frames"}), (("--space", ""), {"rec709-linear", "camera-raw"}):
        found = set(complete("lightstage-render", "x", *words))
        wrong += [f"{words}: {found}"] * (found != wanted)
    return wrong


def complete(*words):
    function = "_" + words[0].replace("-", "_")
    script = (f"source {ROOT}/clients/{words[0]}.bash; COMP_WORDS=(\"$@\"); "
              f"COMP_CWORD=$(($# - 1)); {function}; "
              "printf '%s\\n' \"${COMPREPLY[@]}\"")
    run = subprocess.run(["bash", "-c", script, "bash", *words], check=True, capture_output=True,
                         text=True, env=ENV)
    return run.stdout.split()


def check_completion():
    wrong = []
    for words, wanted in ((("rel",), {"relight"}), (("take", "sh"), {"show"}),
                          (("take", "start", "--pl"), {"--plan"}),
                          (("relight", "x", "--max"), {"--max-error"}),
                          (("fetch", "x", "--max"), {"--max-error"}),
                          (("export", "x", "y", "--space", ""), {"camera", "rec709", "acescg"}),
                          (("relight", "x", "y", "--space", ""), {"rec709-linear", "camera-raw"})):
        found = set(complete("lightstagectl", *words))
        if found != wanted:
            wrong.append(f"{words}: {found}, expected {wanted}")
    missing = {name.split()[0] for name in commands()} - set(complete("lightstagectl", ""))
    return wrong + [f"{name} is not completed" for name in sorted(missing)]


def example(name):
    """Of the page @name, the lines of its example."""
    found, = re.findall(r"# EXAMPLE\n.*?```\n(.*?)```", read(ROOT, "daemon", name + ".scd"), re.DOTALL)
    return found


def check_examples():
    """lightstaged --check takes those of its pages; tests/integration/test_plan_kinds.py a plan's."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in (("daemon.conf", example("lightstaged.conf.5")),
                           ("rig.conf", example("lightstage-rig.5")), ("lights.csv", "0,1,0\n0,0,1.5\n")):
            with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
                file.write(text)
        run = subprocess.run([os.path.join(BUILD, "daemon", "lightstaged"), "--check", "--config",
                              os.path.join(folder, "daemon.conf")], capture_output=True, text=True,
                             check=False)
    return [run.stderr.strip()] * (run.returncode != 0)


def check_errors():
    """Each number of errors.h, and its word, in PROTOCOL.md's table."""
    numbers = re.findall(r"(LS_PROTO_\w+) = (\d+)", read(ROOT, "proto", "errors.h"))
    words = dict(re.findall(r'case (LS_PROTO_\w+):\s+return "([^"]+)";',
                            read(ROOT, "proto", "errors.c")))
    table = read(ROOT, "proto", "PROTOCOL.md")
    assert len(numbers) > 20, numbers
    return [f"PROTOCOL.md does not list {number} {words.get(name)}" for name, number in numbers
            if f"| {number} | {words.get(name)} |" not in table]


def check_capabilities():
    """Each word that HelloReply says stands in PROTOCOL.md."""
    words = re.search(r"capabilities\[\] = \{(.*?)\}", read(ROOT, "daemon", "session.c"), re.DOTALL)
    words = re.findall(r'"(\w+)"', words.group(1))
    assert len(words) > 8, words
    text = read(ROOT, "proto", "PROTOCOL.md")
    return [f"PROTOCOL.md does not name the capability {word}" for word in words
            if f"`{word}`" not in text]


def main():
    checks = (("every key of a file stands in its page", check_keys),
              ("every command and option stands in lightstagectl(1)", check_commands),
              ("every option stands in lightstage-render(1), and bash completes it", check_render),
              ("examples of configuration are good", check_examples),
              ("the protocol lists every error", check_errors),
              ("the protocol names every capability", check_capabilities),
              ("bash completes commands and options", check_completion))
    print(f"1..{len(checks)}")
    failed = 0
    for number, (name, check) in enumerate(checks, 1):
        wrong = check()
        failed += bool(wrong)
        print(f"{'not ok' if wrong else 'ok'} {number} - {name}")
        for line in wrong:
            print(f"# {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
