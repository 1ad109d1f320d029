#!/usr/bin/python3 -B
"""Enforce the layers of the house: who includes whom, what core may call, headers compile alone.

usage: layers.py SOURCE_ROOT BUILD_ROOT [--cc COMMAND...]     speaks TAP
"""
import concurrent.futures
import os
import re
import subprocess
import sys

MAY_INCLUDE = {
    "core": {"core"},
    "proto": {"proto", "core"},
    "drivers": {"drivers", "core"},
    "daemon": {"daemon", "core", "proto", "drivers"},
    "clients": {"clients", "core", "proto"},
    "sim": {"sim", "core"},
}
EXTRA = {"sim": {"drivers/lights_wire.h"}}
# of clients: what makes the library. All else has the library's header and core alone.
OF_LIBRARY = re.compile(r"clients/(library(_\w+)?|connection(_open)?|secure)\.[ch]$")
BEHIND_LIBRARY = re.compile(r"lightstage__|protobuf_c_|ls_(connection|library|secure|frame|message|proto|tls)_")
TOP_LEVEL = {"daemon", "proto", "drivers", "core", "clients", "tests", "sim", "meson.build",
             "README.md", "LICENSE", "meson_options.txt"}
# descriptors, threads, GLib: what core must not reach for
FORBIDDEN = re.compile(r"^(open|openat|creat|fopen|fdopen|popen|opendir|socket|mmap|p?readv?|p?writev?|"
                       r"close|dup[23]?|pipe2?|eventfd|memfd_create|fcntl|ioctl|p?poll|p?select|"
                       r"__open\w*|__p?read\w*|f(read|write|printf|puts|gets|scanf)|stdin|stdout|stderr|"
                       r"pthread_\w+|thrd_\w+|mtx_\w+|sem_\w+|clone|g_\w+)(64)?(@.*)?$")


def files(root, room, suffix):
    for folder, _, names in os.walk(os.path.join(root, room)):
        for name in sorted(names):
            if name.endswith(suffix):
                yield os.path.join(folder, name)


def included(path, pattern):
    for number, line in enumerate(open(path, encoding="utf-8"), 1):
        found = re.match(r"\s*#\s*include\s+" + pattern, line)
        if found:
            yield number, found.group(1)


def sources(root, room):
    return list(files(root, room, ".c")) + list(files(root, room, ".h"))


def check_includes(root):
    wrong = []
    for room, allowed in MAY_INCLUDE.items():
        for path in sources(root, room):
            wrong += [f"{os.path.relpath(path, root)}:{number}: {room} may not include {target}"
                      for number, target in included(path, '"([^"]+)"')
                      if target.split("/")[0] not in allowed and target not in EXTRA.get(room, ())]
    return wrong


def check_library_alone(root, build):
    """What lightstagectl and the other clients include, and what lightstagectl calls."""
    wrong = []
    for path in sources(root, "clients"):
        name = os.path.relpath(path, root)
        if not OF_LIBRARY.match(name):
            wrong += [f"{name}:{number}: speaks by lightstage.h alone, not by {target}"
                      for number, target in included(path, r'["<]([^">]+)[">]')
                      if target.startswith("proto") or OF_LIBRARY.match(target)]
    calls = undefined(os.path.join(build, "clients", "liblightstagectl.a"))
    if "lightstage_connect" not in calls:
        return ["nm shows no calls of lightstagectl at all"]
    return wrong + [f"lightstagectl calls {name}" for name in sorted(calls)
                    if BEHIND_LIBRARY.match(name)]


def undefined(archive):
    text = subprocess.run(["nm", "-u", archive], capture_output=True, text=True, check=True).stdout
    return {line.split()[-1] for line in text.splitlines() if line.strip().startswith("U ")}


def check_core_symbols(build):
    """The kernels' archives, one for each instruction set, too."""
    folder = os.path.join(build, "core")
    archives = [name for name in os.listdir(folder) if re.match(r"libcore\w*\.a$", name)]
    names = set().union(*(undefined(os.path.join(folder, name)) for name in archives))
    if "malloc" not in names or "libcore.a" not in archives:
        return [f"nm shows not all of core: {sorted(archives)}"]
    return [f"core calls {name}" for name in sorted(names) if FORBIDDEN.match(name)]


def check_top_level(root):
    listed = subprocess.run(["git", "-C", root, "ls-files"], capture_output=True, text=True)
    names = {line.split("/")[0] for line in listed.stdout.splitlines()}
    if listed.returncode or "core" not in names:
        return [f"git does not list the tree: {listed.stderr.strip()}"]
    return [f"{name} does not belong at the top level" for name in sorted(names)
            if name not in TOP_LEVEL and not name.startswith(".")]


def compiles(arguments):
    cc, flags, root, path = arguments
    done = subprocess.run([*cc, "-fsyntax-only", "-std=gnu11", "-D_GNU_SOURCE", "-Wall", "-Wno-unused", "-Werror",
                           "-I", root, *flags, "-x", "c", path], capture_output=True, text=True)
    return [] if done.returncode == 0 else [f"{os.path.relpath(path, root)} does not compile alone: "
                                            f"{(done.stderr.splitlines() or ['?'])[0]}"]


def check_headers(root, build, cc):
    flags = subprocess.run(["pkg-config", "--cflags", "aravis-0.8", "gio-unix-2.0", "OpenEXR",
                            "jansson", "libprotobuf-c", "libmodbus", "libconfig"], capture_output=True, text=True,
                           check=True).stdout.split()
    flags += ["-I", build, "-I", os.path.join(build, "proto")]
    headers = [path for room in MAY_INCLUDE for path in files(root, room, ".h")]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        results = pool.map(compiles, [(cc, flags, root, path) for path in headers])
    return [line for result in results for line in result]


def check_readmes(root):
    return [f"{room}/README.md is missing" for room in [*MAY_INCLUDE, "tests"]
            if not os.path.exists(os.path.join(root, room, "README.md"))]


def main():
    root, build = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    cc = sys.argv[4:] or ["gcc"]
    checks = [
        ("every include stays within its layer", lambda: check_includes(root)),
        ("lightstagectl speaks by the library alone", lambda: check_library_alone(root, build)),
        ("core calls no descriptors, threads or GLib", lambda: check_core_symbols(build)),
        ("the top level holds what it should", lambda: check_top_level(root)),
        ("every header compiles alone", lambda: check_headers(root, build, cc)),
        ("every folder has its page", lambda: check_readmes(root)),
    ]
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
