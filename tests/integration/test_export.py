#!/usr/bin/python3 -B
"""lightstagectl export: files that hold what fetch brings, say what they are, and are never half."""
import json
import os
import shutil
import subprocess

import numpy as np

import harness
import pictures

LIGHTS = "0,7"


def exported(rig, take, *options):
    return json.loads(rig.control("export", take, rig.path("out"), "--json", *options))


def fetched(rig, take, channel, *options):
    prefix = rig.path("fetched" + channel)
    rig.control("fetch", take, "--channel", channel, "--lights", LIGHTS, "--layout", "rgb",
                "--output", prefix, *options)
    return [pictures.read(f"{prefix}.{light:04d}.exr") for light in (1, 8)]


def pixels_are_those_of_fetch(rig, take):
    told = exported(rig, take, "--lights", LIGHTS)
    assert (told["written"], told["skipped"]) == (2, 0), told
    files = [os.path.join(rig.path("out"), frame["file"]) for frame in told["frames"]]
    assert [os.path.basename(f) for f in files] == [f"{take}.0001.exr", f"{take}.0008.exr"], files
    for channel in "WRAGCB":
        model = ("--model", "measured" if channel == "W" else "sphere")
        for path, expected in zip(files, fetched(rig, take, channel, *model)):
            part = pictures.read(path, channel)
            assert part is not None and expected.any(), (path, channel)
            assert np.array_equal(part, expected), (path, channel)
    return files


def packed_is_the_same_and_smaller(rig, take):
    plain, packed = rig.path("plain"), rig.path("packed")
    for folder, *options in ((plain,), (packed, "--packed")):
        rig.control("export", take, folder, "--lights", "7", "--half", *options)
    a, b = (os.path.join(folder, f"{take}.0008.exr") for folder in (plain, packed))
    for channel in "WRAGCB":
        assert np.array_equal(pictures.read(a, channel), pictures.read(b, channel)), channel
    assert os.path.getsize(b) < os.path.getsize(a)


def what_is_whole_is_skipped(rig, take, files):
    before = [os.stat(path).st_mtime_ns for path in files]
    with open(files[1], "rb") as file:
        whole = file.read()
    with open(files[1], "wb") as file:
        file.write(whole[:-100])
    told = exported(rig, take, "--lights", LIGHTS)
    assert (told["written"], told["skipped"]) == (1, 1), told
    assert os.stat(files[0]).st_mtime_ns == before[0]
    with open(files[1], "rb") as file:
        assert file.read() == whole
    told = exported(rig, take, "--lights", LIGHTS, "--channels", "W")
    assert (told["written"], told["skipped"]) == (2, 0), "other options, other files"
    assert sorted(os.listdir(rig.path("out"))) == sorted(
        [*map(os.path.basename, files), f"{take}.json", f"{take}.csv"])


def test_export_writes_what_fetch_brings_and_skips_what_is_whole(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("export", harness.PLAN)
    files = pixels_are_those_of_fetch(rig, take)
    if shutil.which("oiiotool"):
        said = subprocess.run(["oiiotool", "--info", "-v", "-a", files[1]], check=True,
                              capture_output=True, text=True).stdout
        for words in ("6 subimages", "channel list: W.R, W.G, W.B", "channel list: B.R, B.G, B.B",
                      "oiio:subimagename: \"A\"", "lightstage/light: 7", "lightstage/units: \"R\"", "lightstage/position:",
                      "worldToCamera", "tile size: 64 x 64"):
            assert words in said, (words, said)
    else:
        print("# oiiotool is not installed: attributes are not read back by it")
    packed_is_the_same_and_smaller(rig, take)
    what_is_whole_is_skipped(rig, take, files)
    harness.refuses("--channels X", lambda: exported(rig, take, "--channels", "X"))


harness.main(globals())
