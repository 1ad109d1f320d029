#!/usr/bin/python3 -B
"""lightstagectl export: files that hold what fetch brings, say what they are, and are never half."""
import json
import os
import signal
import struct
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
    halves = fetched(rig, take, "G", "--half", "--model", "sphere")[1]
    assert np.array_equal(pictures.read(b, "G"), halves)
    assert os.path.getsize(b) < os.path.getsize(a)


def xyz(primaries):
    """The matrix from linear RGB to XYZ of red, green, blue, white in xy."""
    xy = np.array(primaries, float).reshape(4, 2)
    columns = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(axis=1)) / xy[:, 1]])
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3]), columns[:, 3]


REC709 = 0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290
ACESCG = 0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767


def rec709_to_acescg():
    (source, d65), (target, aces) = xyz(REC709), xyz(ACESCG)
    bradford = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367],
                         [0.0389, -0.0685, 1.0296]])
    adapted = np.linalg.solve(bradford, np.diag(bradford @ aces / (bradford @ d65)) @ bradford)
    return np.linalg.solve(target, adapted @ source)


def told_primaries(path):
    kind, value = pictures.attributes(path)["chromaticities"]
    assert kind == "chromaticities"
    return np.frombuffer(value, "<f4")


def colours_are_those_of_the_matrix(rig, take):
    """Of every value v of matrix m at most 2^-24 of the result, rounded, and as much of the sum of
    |m v| for numpy's own way of adding; of a half, 2^-11, or half of the smallest there is."""
    with open(os.path.join(rig.path("takes"), take, "take.json"), encoding="utf-8") as file:
        m = np.array(json.load(file)["calibration"]["M"])
    camera = os.path.join(rig.path("out"), f"{take}.0008.exr")
    for name, matrix, primaries in (("rec709", m, REC709), ("acescg", rec709_to_acescg() @ m, ACESCG)):
        samples = {"": (2.0**-24, 0), "--half": (2.0**-11, 2.0**-25)}
        for sample, (step, least) in list(samples.items())[:2 if name == "acescg" else 1]:
            rig.control("export", take, rig.path(name), "--lights", "7", "--channels", "W,B",
                        "--space", name, *sample.split())
            path = os.path.join(rig.path(name), f"{take}.0008.exr")
            assert np.array_equal(told_primaries(path), np.float32(primaries))
            told = {key: value for key, (_, value) in pictures.attributes(path).items()}
            assert told["lightstage/space"].decode().startswith(name), told
            assert np.array_equal(np.frombuffer(told["adoptedNeutral"], "<f4"),
                                  np.float32(primaries[6:]))
            for channel in "WB":
                v = pictures.read(camera, channel)
                size = np.abs(v) @ np.abs(matrix).T
                wrong = np.abs(pictures.read(path, channel) - v @ matrix.T)
                assert np.all(wrong <= step * size + least), (name, channel, (wrong / size).max())
    assert "chromaticities" not in pictures.attributes(camera)


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
        [*map(os.path.basename, files), f"{take}.json", f"{take}.csv", f"{take}.png"])


def contents(folder):
    """What is under its last name; a killed writer leaves NAME.XXXXXX."""
    found = {}
    for name in os.listdir(folder):
        if name.endswith(".exr"):
            with open(os.path.join(folder, name), "rb") as file:
                found[name] = file.read()
    return found


def killed(rig, take, folder, *options):
    """What is there when an export is killed halfway; None: it was done before."""
    with subprocess.Popen([rig.program("clients/lightstagectl"), "--socket", rig.path("socket"), "export",
                           take, folder, *options], stdout=subprocess.DEVNULL) as child:
        harness.wait_for("some files are there",
                         lambda: os.path.isdir(folder) and len(contents(folder)) > 2)
        child.kill()
    return contents(folder) if child.returncode == -signal.SIGKILL else None


def killed_and_done_again_is_the_same(rig, take):
    options = "--packed", "--channels", "W,R,A"
    rig.control("export", take, rig.path("whole"), *options)
    expected = contents(rig.path("whole"))
    for attempt in range(8):  # this program may wait while that one goes on
        cut = rig.path(f"cut{attempt}")
        left = killed(rig, take, cut, *options)
        if left and len(left) < 12:
            break
    assert 2 < len(left) < 12 == len(expected) and left.items() <= expected.items(), sorted(left)
    told = json.loads(rig.control("export", take, cut, *options, "--json"))
    assert (told["written"], told["skipped"]) == (12 - len(left), len(left)), told
    assert contents(cut) == expected


def sheet_is_there(rig, take):
    told = exported(rig, take, "--lights", LIGHTS)["contact_sheet"]
    assert (told["file"], told["channel"]) == (f"{take}.png", "W") and told["scale"] > 0, told
    with open(os.path.join(rig.path("out"), told["file"]), "rb") as file:
        size = struct.unpack(">II", file.read(24)[16:])
    assert size == (4 + 2 * (128 + 4), 4 + 128 + 2 * 9 + 4), size


KEPT = {}  # of light 7, for the tests below: number of spectra to the bytes of a file


def keep(rig, take):
    for channels in "W", "W,R,A", "W,R,A,G,C,B":
        rig.control("export", take, rig.path("kept"), "--lights", "7", "--channels", channels)
        with open(os.path.join(rig.path("kept"), f"{take}.0008.exr"), "rb") as file:
            KEPT[len(channels.split(","))] = file.read()


def wrong_input_is_refused(rig, take):
    for words, *options in (("--channels X", "--channels", "X"), ("--lights 99", "--lights", "99"),
                            ("--space srgb: expected camera", "--space", "srgb"),
                            ("camera", "--camera", "1")):
        harness.refuses(words, lambda options=options: exported(rig, take, *options))
    harness.refuses("not found", lambda: exported(rig, "no-such-take"))
    harness.refuses("plan.conf", lambda: rig.control("export", take, rig.path("plan.conf")), code=2)


def test_exported_files_hold_what_fetch_brings(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("export", harness.PLAN)
    files = pixels_are_those_of_fetch(rig, take)
    keep(rig, take)
    packed_is_the_same_and_smaller(rig, take)
    colours_are_those_of_the_matrix(rig, take)
    sheet_is_there(rig, take)
    killed_and_done_again_is_the_same(rig, take)
    what_is_whole_is_skipped(rig, take, files)
    wrong_input_is_refused(rig, take)


def kept(folder, spectra):
    if not KEPT:  # chosen alone
        rig = harness.twelve(folder).start()
        keep(rig, rig.start_take("export", harness.PLAN))
    path = os.path.join(folder, f"{spectra}.exr")
    with open(path, "wb") as file:
        file.write(KEPT[spectra])
    return path


BLENDER = """
import bpy, sys, numpy
layers, picture, out = sys.argv[-3:]
bpy.context.scene.use_nodes = True
node = bpy.context.scene.node_tree.nodes.new("CompositorNodeImage")
node.image = bpy.data.images.load(layers)
image = bpy.data.images.load(picture)
pixels = numpy.empty(image.size[0] * image.size[1] * 4, numpy.float32)
image.pixels.foreach_get(pixels)
numpy.savez(out, outputs=[o.name for o in node.outputs], pixels=pixels, size=image.size)
"""


def test_every_spectrum_is_a_layer_in_blender_and_pixels_are_what_was_exported(folder):
    harness.need("blender")
    layers, picture, out = kept(folder, 3), kept(folder, 1), os.path.join(folder, "blender.npz")
    subprocess.run(["blender", "--background", "--factory-startup", "-noaudio", "--python-exit-code",
                    "1", "--python-expr", BLENDER, "--", layers, picture, out],
                   check=True, stdout=subprocess.DEVNULL, timeout=120, env={**os.environ, "HOME": folder})
    seen = np.load(out)
    assert set(seen["outputs"]) == set("WRA"), seen["outputs"]
    width, height = seen["size"]
    pixels = seen["pixels"].reshape(height, width, 4)[::-1]  # from the lowest row up
    assert np.array_equal(pixels[:, :, :3], pictures.read(picture))


def test_oiiotool_reads_names_and_attributes_back(folder):
    harness.need("oiiotool")
    said = subprocess.run(["oiiotool", "--info", "-v", "-a", kept(folder, 6)], check=True,
                          capture_output=True, text=True).stdout
    for words in ("6 subimages", "channel list: W.R, W.G, W.B", "channel list: B.R, B.G, B.B",
                  "oiio:subimagename: \"A\"", "lightstage/light: 7", "lightstage/units: \"R\"",
                  "reads 1/pi", "lightstage/position:", "m from the stage's centre",
                  "lightstage/duty: 1", "worldToCamera", "tile size: 64 x 64"):
        assert words in said, (words, said)


harness.main(globals())
