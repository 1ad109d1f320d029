#!/usr/bin/python3 -B
"""A take explains itself: its files alone are enough, and any OpenEXR program reads them."""
import glob
import json
import os
import subprocess
import sys

import numpy as np

import harness
import pictures
import reader

STANDARD = {"capDate", "utcOffset", "timeCode", "cameraMake", "cameraModel",
            "cameraSerialNumber", "worldToCamera", "lensModel", "aperture", "isoSpeed"}
EVERY = STANDARD | {"lightstage/take", "lightstage/calibration", "lightstage/conventions",
                    "lightstage/units"}
PHOTOGRAPHED = EVERY | {"expTime", "lightstage/cfa", "lightstage/blackSubtracted"}
VALUED = {"lightstage/model", "lightstage/reference"}
FIELD = PHOTOGRAPHED | VALUED | {"lightstage/gain", "lightstage/referenceExposure",
                                 "lightstage/channel"}
ONE = FIELD | {"lightstage/light", "lightstage/position", "lightstage/direction"}


def taken(folder, **options):
    """A rig of twelve lights with one take: (rig, take, the take's folder)."""
    rig = harness.twelve(folder, **options).start()
    take = rig.start_take("proof", harness.PLAN)
    return rig, take, rig.path(os.path.join("takes", take))


def weights(rig, **rows):
    path = rig.path("weights.json")
    harness.stage.write(path, json.dumps(rows))
    return path


def even_pixels(picture, n):
    """n pixels of every CFA colour where a picture of 5 x 5 pixels around changes by less than half:
    at edges the ratio leans on its neighbourhood (core/promote.h)."""
    around = np.lib.stride_tricks.sliding_window_view(picture, (5, 5), axis=(0, 1))
    low, high = around.min(axis=(3, 4)), around.max(axis=(3, 4))
    y, x = np.nonzero(np.all((high < 1.5 * low) & (low > 0.05 * picture.max()), axis=2))
    for phase in range(4):
        here = np.nonzero(y % 2 * 2 + x % 2 == phase)[0]
        for j in here[np.linspace(0, len(here) - 1, n).astype(int)]:
            yield int(x[j]) + 2, int(y[j]) + 2


def test_a_numpy_script_rebuilds_a_relit_pixel_from_the_files_alone(folder):
    rig, take, files = taken(folder)
    rng = np.random.default_rng(7)
    rows = {"W": rng.uniform(0, 1, 12).tolist(), "R": rng.uniform(0, 1, 12).tolist(),
            "C": rng.uniform(0, 1, 12).tolist()}
    rig.control("relight", take, "--weights", weights(rig, W=[1] * 12), "--raw", "--output",
                rig.path("white.exr"))
    places = list(even_pixels(pictures.read(rig.path("white.exr")), 6))
    path = weights(rig, **rows)
    rig.control("relight", take, "--weights", path, "--raw", "--output", rig.path("relit.exr"))
    relit = pictures.read(rig.path("relit.exr"))
    worst = 0.0
    for x, y in places:
        colour, value = reader.rebuild(files, rows, x, y)
        worst = max(worst, abs(value / relit[y, x, colour] - 1))
    # Both start from the same stored halves. The daemon adds 12 lights in float, at most
    # (12/8 + 9) 2^-24 = 6e-7 of a sum (core/relight.h), for the light, F and V of three spectra,
    # and rounds a handful of products: 3e-6.
    print(f"# worst relative difference {worst:.2e}")
    assert worst < 3e-6, worst
    x, y = places[0]
    said = subprocess.run([sys.executable, reader.__file__, files, path, str(x), str(y)],
                          check=True, capture_output=True, text=True).stdout.split()
    assert float(said[1]) == reader.rebuild(files, rows, x, y)[1]
    lines = len(harness.stage.read(reader.__file__).splitlines())
    assert lines <= 60, f"the reader has grown to {lines} lines"


def test_given_weights_that_do_not_fit_the_take_are_refused(folder):
    rig, take, _ = taken(folder)
    for text, sentence in (("{", "weights.json:1"), ("[]", "expected weights as"),
                           ('{"W": [1, 2]}', "expected an array of 12 weights"),
                           ('{"Q": [1]}', 'no channel "Q"'),
                           (json.dumps({"W": [1] * 11 + ["x"]}), "light 11: expected a number")):
        harness.stage.write(rig.path("weights.json"), text)
        harness.refuses(sentence, lambda: rig.control(
            "relight", take, "--weights", rig.path("weights.json"), "--output",
            rig.path("x.exr")), 2)
    assert not os.path.exists(rig.path("x.exr"))


def names_in_headers(paths):
    """What exrheader prints of each file, by path: the names of the first part's attributes."""
    found = {}
    for line in harness.stage.call("exrheader", *paths).splitlines():
        if line.startswith("file ") and line.endswith(":"):
            names = found[line[5:-1]] = set()
        elif " (type " in line:
            names.add(line.split(" (type ")[0])
    return found


def test_every_picture_opens_in_other_programs_and_says_what_it_is(folder):
    harness.need("exrheader")
    harness.need("oiiotool")
    rig, take, files = taken(folder)
    expected = {}
    for path in glob.glob(os.path.join(files, "cam0", "*.exr")):
        name = os.path.basename(path)
        expected[path] = (
            PHOTOGRAPHED if name.startswith("dark") else
            FIELD | {"lightstage/duty"} if name.startswith("sphere") else
            ONE | {"lightstage/duty"})
    assert len(expected) == 3 + 6 + 12
    out = rig.path("field")
    rig.control("fetch", take, "--channel", "W", "--lights", "0,11", "--output", out)
    rig.control("fetch", take, "--channel", "R", "--lights", "3", "--model", "sphere", "--layout",
                "rgb", "--half", "--output", out + "-red")
    rig.control("fetch", take, "--channel", "G", "--full-sphere", "--output", out + "-sphere")
    expected.update({out + ".0001.exr": ONE, out + ".0012.exr": ONE, out + "-red.0004.exr": ONE,
                     out + "-sphere.exr": FIELD})
    rig.control("relight", take, "--weights", weights(rig, W=[1] * 12, R=[1] * 12), "--output",
                rig.path("relit.exr"))
    rig.control("relight", take, "--weights", rig.path("weights.json"), "--raw", "--output",
                rig.path("raw.exr"))
    expected[rig.path("raw.exr")] = EVERY | VALUED | {"lightstage/models"}
    expected[rig.path("relit.exr")] = expected[rig.path("raw.exr")] | {"chromaticities"}
    shown = names_in_headers(sorted(expected))
    for path, names in expected.items():
        assert names <= shown[path], f"{path}: exrheader lacks {sorted(names - shown[path])}"
        assert path.endswith("relit.exr") or "chromaticities" not in shown[path]
    said = harness.stage.call("oiiotool", "--info", "-v", *expected)
    for path in expected:
        assert f"Reading {path}\n" in said, f"oiiotool does not open {path}"
    assert said.count("channel list: ") == len(expected) == said.count("lightstage/take: ")


def test_numbers_begin_at_zero_inside_and_at_one_in_frame_names(folder):
    """1-based numbering anywhere between controller, take, export and truth would show here."""
    rig, take, files = taken(folder)
    rig.control("fetch", take, "--channel", "W", "--output", rig.path("field"))
    rig.simulator("field", "--lights", "0-11", "--channels", "W", "--mosaic", "--output", folder)
    sidecar = json.loads(harness.stage.read(rig.path("field.json")))["frames"]
    table = harness.stage.read(rig.path("field.csv")).splitlines()[1:]
    document = json.loads(harness.stage.read(os.path.join(files, "take.json")))
    assert [f["light"] for f in sidecar] == list(range(12))
    ours = [pictures.read(rig.path(f"field.{i + 1:04d}.exr")).ravel() for i in range(12)]
    true = [pictures.read(rig.path(f"W.{i + 1:04d}.exr")).ravel() for i in range(12)]
    for i, frame in enumerate(sidecar):
        assert os.path.basename(frame["file"]) == f"field.{i + 1:04d}.exr"
        assert int(table[i].split(",")[1]) == i
        said = pictures.attributes(rig.path(f"field.{i + 1:04d}.exr"))
        position = np.frombuffer(said["lightstage/position"][1], "<f4")
        assert int.from_bytes(said["lightstage/light"][1], "little") == i
        assert np.allclose(position, document["rig"]["lights"]["position_m"][i], atol=1e-6)
        nearest = int(np.argmin([np.sum((ours[i] - t) ** 2) for t in true]))
        assert nearest == i, f"frame of light {i} shows light {nearest}"


def test_a_region_at_odd_offsets_is_the_crop_of_the_whole(folder):
    """The CFA phase of a crop: wrong by one pixel, red and blue change places."""
    rig, take, _ = taken(folder, size=144)
    for layout in ("mosaic", "rgb"):
        for channel, model in (("W", "measured"), ("R", "sphere"))[:1 if layout == "mosaic" else 2]:
            ask = ("fetch", take, "--channel", channel, "--model", model, "--lights", "5",
                   "--layout", layout, "--output")
            rig.control(*ask, rig.path("whole"))
            whole = pictures.read(rig.path("whole.0006.exr"))
            for x, y, w, h in ((1, 1, 31, 17), (63, 64, 3, 3), (127, 7, 17, 137), (0, 65, 1, 1)):
                rig.control(*ask, rig.path("crop"), "--region", f"{x},{y},{w},{h}")
                crop = pictures.read(rig.path("crop.0006.exr"))
                assert np.array_equal(crop, whole[y:y + h, x:x + w]), (layout, channel, x, y)
    path = weights(rig, W=list(range(12)), G=[1] * 12)
    rig.control("relight", take, "--weights", path, "--output", rig.path("whole.exr"))
    rig.control("relight", take, "--weights", path, "--output", rig.path("crop.exr"), "--region",
                "33,65,61,71")
    whole, crop = pictures.read(rig.path("whole.exr")), pictures.read(rig.path("crop.exr"))
    assert np.array_equal(crop, whole[65:136, 33:94])


def told_variance(e, camera, exposures):
    """Variance of E by method: 1 / sum t^2 / sigma^2 over the exposures in range, else of the longest
    that is not too bright, else of the shortest."""
    t, full = np.sort(exposures)[:, None], camera["full_scale_dn"]
    expected = camera["black_dn"] + e * full * t
    low, high = (limit * full for limit in camera["range"])
    sigma2 = (camera["read_noise_dn"] ** 2 + 1 / 12 +
              np.maximum(e * full * t, 0) / camera["electrons_per_dn"])
    each = sigma2 / t ** 2 / full ** 2
    within = (expected >= low) & (expected <= high)
    longest = np.maximum((expected <= high).sum(axis=0) - 1, 0)
    with np.errstate(divide="ignore"):
        return np.where(within.any(axis=0), 1 / np.sum(within / each, axis=0),
                        np.take_along_axis(each, longest[None], 0)[0])


def test_validity_and_variance_are_those_of_the_stored_picture(folder):
    """Of one light: no part may be exchanged, shifted or of another exposure."""
    rig, take, files = taken(folder, size=144)
    out = rig.path("known")
    said = json.loads(rig.control("fetch", take, "--channel", "W", "--lights", "5", "--estimate",
                                  "--validity", "--variance", "--output", out, "--json"))
    fetched, stored = out + ".0006.exr", os.path.join(files, "cam0", "W-0005.exr")
    document = json.loads(harness.stage.read(os.path.join(files, "take.json")))
    camera, reference = document["rig"]["cameras"][0], document["reference_exposure_s"]
    values = pictures.read(fetched)
    assert np.array_equal(values, pictures.read(stored))
    validity = pictures.read(stored, "validity")
    assert np.array_equal(pictures.read(fetched, "validity"), validity)
    dark = int(np.sum(validity == 2))
    assert 0 < dark < validity.size, "a picture that is neither dark nor bright everywhere"
    assert said["frames"][0]["validity"]["dark"] == dark
    variance = pictures.read(fetched, "variance").ravel()
    true = told_variance(values.ravel() / reference, camera, np.array(document["exposure_s"]))
    assert np.allclose(variance, true * reference ** 2, rtol=1e-5, atol=0)  # float32


harness.main(globals())
