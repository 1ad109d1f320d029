#!/usr/bin/python3 -B
"""liblightstage as its user has it: installed, found by pkg-config, used from C and from C++.

usage: test_installed.py     speaks TAP
"""
import os
import re
import shlex
import subprocess
import sys
import tempfile

ROOT, BUILD = os.environ["LS_SOURCE_ROOT"], os.environ["LS_BUILD_ROOT"]
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
BY_CPP = """#include <lightstage.h>
#include <cstdio>
int main(int, char **argv)
{
    lightstage_address address = {};
    lightstage *stage = nullptr;
    lightstage_error error;
    address.size = sizeof address;
    address.where = argv[1];
    if (lightstage_connect(&address, &stage, &error)) {
        std::fprintf(stderr, "%u: %s\\n", error.number, error.text);
        return 1;
    }
    lightstage_close(stage);
}
"""


def output(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout


def install(folder):
    """Into @folder; its library folder and the flags that pkg-config names."""
    output("meson", "install", "-C", BUILD, "--no-rebuild", "--tags", "devel,runtime",
           env={**os.environ, "DESTDIR": folder})
    found = [f for f, _, names in os.walk(folder) if "lightstage.pc" in names]
    assert len(found) == 1, found
    library = os.path.dirname(found[0])
    flags = output("pkg-config", "--cflags", "--libs", "lightstage",
                   env={**os.environ, "PKG_CONFIG_PATH": found[0],
                        "PKG_CONFIG_SYSROOT_DIR": folder,
                        "PKG_CONFIG_ALLOW_SYSTEM_LIBS": "1"})
    return library, shlex.split(flags)


def example(folder):
    """The one that is installed."""
    found, = (os.path.join(f, name) for f, _, names in os.walk(folder) for name in names
              if name == "lightstage_example.c")
    assert os.path.dirname(found).endswith("/share/doc/lightstaged/examples"), found
    return found


def cpp(folder):
    path = os.path.join(folder, "program.cc")
    with open(path, "w", encoding="utf-8") as file:
        file.write(BY_CPP)
    return path


def compiled(folder, flags, source, compiler, standard):
    program = os.path.join(folder, f"by-{compiler}")
    done = subprocess.run([compiler, *STRICT, standard, source, *flags, "-o", program],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return program


def says_that_nobody_answers(folder, library, flags, *how):
    program = compiled(folder, flags, *how)
    done = subprocess.run([program, os.path.join(folder, "none"), "take", "W"], capture_output=True,
                          text=True, env={**os.environ, "LD_LIBRARY_PATH": library}, timeout=20)
    assert done.returncode == 1 and done.stderr.startswith("1: no lightstaged answers"), done


def check_program(folder, library):
    program = next(os.path.join(f, "lightstagectl") for f, _, names in os.walk(folder)
                   if "lightstagectl" in names and f.endswith("/bin"))
    version = output(program, "--version", env={**os.environ, "LD_LIBRARY_PATH": library})
    assert version.startswith("lightstagectl "), version
    needed = output("readelf", "-d", program)
    assert "[liblightstage.so.0]" in needed and "protobuf" not in needed, needed


def check_protocol(folder):
    found = {name: f for f, _, names in os.walk(folder) for name in names}
    for name in "PROTOCOL.md", "lightstage.proto":
        assert found.get(name, "").endswith("/share/doc/lightstaged"), found.get(name)
        with open(os.path.join(found[name], name), "rb") as there, \
                open(os.path.join(ROOT, "proto", name), "rb") as here:
            assert there.read() == here.read(), name


def check_symbols(library):
    header = open(os.path.join(ROOT, "clients", "lightstage.h"), encoding="utf-8").read()
    header = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    declared = set(re.findall(r"^(?:[a-z_0-9]+ )+\*?(lightstage_\w+)\(", header, flags=re.M))
    declared -= set(re.findall(r"^typedef int (\w+)\(", header, flags=re.M))
    shown = output("nm", "-D", "--defined-only", os.path.join(library, "liblightstage.so.0"))
    assert declared == {line.split()[-1] for line in shown.splitlines()}, declared
    named = output("readelf", "-d", os.path.join(library, "liblightstage.so"))
    assert "[liblightstage.so.0]" in named and "glib" not in named, named


def main():
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        library, flags = install(folder)
        checks = [
            ("the library shows what its header declares", lambda: check_symbols(library)),
            ("lightstagectl speaks by the library", lambda: check_program(folder, library)),
            ("the protocol is written down beside it", lambda: check_protocol(folder)),
            ("the example is strict C99", lambda: says_that_nobody_answers(
                folder, library, flags, example(folder), "gcc", "-std=c99")),
            ("the library is used from C++", lambda: says_that_nobody_answers(
                folder, library, flags, cpp(folder), "g++", "-std=c++11")),
        ]
        print(f"1..{len(checks)}")
        for number, (name, check) in enumerate(checks, 1):
            try:
                check()
                print(f"ok {number} - {name}")
            except (AssertionError, subprocess.SubprocessError) as error:
                failed = 1
                print(f"not ok {number} - {name}\n#", str(error).replace("\n", "\n# "))
    return failed


if __name__ == "__main__":
    sys.exit(main())
