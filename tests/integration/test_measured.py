#!/usr/bin/python3 -B
"""Measured data goes the same way: photographs, a real rig's positions, captured environments."""
import glob
import json
import os
import shutil
import subprocess

import numpy as np

import geometry
import harness
import pictures

REAL_RIG = ("rig", "ict_lightstage_x_346_positions_cm.csv")
COINCIDENT = (196, 321)  # rows that stand twice, from 0
SPECTRA = "WRAGCB"
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
ODD_PRIMARIES = "0.7347,0.2653,0,1,0.0001,-0.077,0.32168,0.33767"  # ACES


def relit(rig, take, *how):
    rig.control("relight", take, *how, "--output", rig.path("relit.exr"))
    return pictures.read(rig.path("relit.exr"))


def weights(rig, **rows):
    path = rig.path("weights.json")
    harness.stage.write(path, json.dumps(rows))
    return "--weights", path


# ---- photographs ----

def converted(folder, paths, channels):
    """Pictures of 8 bits as numpy, by way of oiiotool: (height, width, 3), 0 to 255."""
    outputs = [os.path.join(folder, f"converted-{i}.ppm") for i in range(len(paths))]
    steps = [word for path, out in zip(paths, outputs)
             for word in (path, "--ch", channels, "-d", "uint8", "-o", out)]
    harness.stage.call(harness.need("oiiotool"), *steps)
    for out in outputs:
        with open(out, "rb") as file:
            _, size, _, rest = file.read().split(b"\n", 3)
        width, height = map(int, size.split())
        yield np.frombuffer(rest, np.uint8).reshape(height, width, 3).astype(float)


def probe_directions(folder, probe):
    """Towards each light, from its highlight on a chrome ball: x right, y up, z towards."""
    x0, y0, r = map(float, harness.stage.read(os.path.join(probe, "circle_data.txt")).split())
    found = []
    photographs = sorted(glob.glob(os.path.join(probe, "Image_*.JPG")))
    for picture in converted(folder, photographs, "0,1,2"):
        level = picture.min(axis=2)
        y, x = np.mgrid[0:level.shape[0], 0:level.shape[1]]
        on = (level >= 250) & ((x - x0) ** 2 + (y - y0) ** 2 < 0.95 * r * r)
        nx, ny = (x[on].mean() - x0) / r, (y0 - y[on].mean()) / r
        nz = np.sqrt(1 - nx * nx - ny * ny)
        found.append((2 * nz * nx, 2 * nz * ny, 2 * nz * nz - 1))
    return np.array(found)


def srgb_to_linear(v):
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def variance(s):
    """Of the merged estimate of a photograph's value: shot, read and pixel response, from the
    exposures in [0.10, 0.85] of full scale; the longest where all are below. Simulator's defaults."""
    electrons_per_us = 10500 * 0.5 / 4000  # at s = 1
    t = np.zeros(s.shape)
    read = np.zeros(s.shape)
    for exposure in (1013.7, 5013.7, 25013.7):
        level = s * 0.5 / 4000 * exposure
        used = (level >= 0.10) & (level <= 0.85)
        used |= (exposure > 25000) & (level < 0.10)
        t += used * exposure
        read += used * 25.0
    electrons = electrons_per_us * t
    return s / electrons + read / electrons ** 2 + (0.005 * s) ** 2


def test_photographs_of_an_object_are_captured_merged_stored_and_relit(folder):
    objects = harness.data("stacks", "psbox", "Objects")
    directions = probe_directions(folder, harness.data("stacks", "psbox", "LightProbe-1"))
    assert len(directions) == 12
    harness.stage.write(os.path.join(folder, "lights.csv"), "".join(
        "%.6f,%.6f,%.6f\n" % tuple(d) for d in directions))  # at 1 m
    rig = harness.rig_of(
        folder, size=(432, 552), scene="replay", channels="W", cfa="mono", pixel_format="Mono12",
        calibrated=False, scene_extra=f'replay = "{objects}"; gain_sigma = 0.0; '
        'positions = "lights.csv"; channels = ( { name = "W"; spectrum = "white"; } );').start()
    take = rig.start_take("photographs", """subject = "still"; exposures_us = [1000, 5000, 25000];
darks = 32; conditions = ( { kind = "each"; channels = ["W"]; } );""")
    rig.control("fetch", take, "--channel", "W", "--estimate", "--output", rig.path("e"))
    sources = [srgb_to_linear(picture[:, :, 0] / 255) for picture in
               converted(folder, sorted(glob.glob(os.path.join(objects, "*.png"))), "0,0,0")]
    stored = []
    for i, source in enumerate(sources):
        e = pictures.read(rig.path(f"e.{i + 1:04d}.exr"))[:, :, 0]
        assert e.shape == (552, 432)
        height, width = source.shape
        assert (height, width) == (550, 430)
        # what the photograph does not cover is dark
        assert abs(e[height:].mean()) < 1e-3 and abs(e[:, width:].mean()) < 1e-3
        stored.append(e[:height, :width])
    scale = np.sum([np.sum(e * s) for e, s in zip(stored, sources)]) / \
        np.sum([np.sum(s * s) for s in sources])
    # white is a 90 % diffuser, which reads half of full scale in 4 ms; stored is E x 25.0137 ms
    expected = 0.5 / 4000 * 25013.7
    nearest = [int(np.argmin([np.sum((e / scale - s) ** 2) for s in sources])) for e in stored]
    errors = [np.sqrt(np.mean((e / scale - s) ** 2) / np.mean(s ** 2))
              for e, s in zip(stored, sources)]
    predicted = [np.sqrt(np.mean(variance(s)) / np.mean(s ** 2)) for s in sources]
    ratios = np.array(errors) / predicted
    print(f"# relative RMS of E against the photographs {min(errors):.4f} to {max(errors):.4f}, "
          f"{ratios.min():.2f} to {ratios.max():.2f} of the sensor's noise; scale "
          f"{scale:.4f}, expected {expected:.4f}")
    assert nearest == list(range(12)), nearest
    # the levels of the photographs are those of 8 bits: what the simulator shows, exactly; what is
    # left is its sensor. 10 %: the merge is allowed 5 % over the bound, and the rest is in pixels
    # near the range's edges, where the model here decides by the truth
    assert 0.85 < ratios.min() and ratios.max() < 1.10, ratios
    assert abs(scale / expected - 1) < 0.01, scale
    # relit in grey: with unit gains and p = 1 a picture is the plain sum
    w = np.linspace(0.5, 1.5, 12)
    picture = relit(rig, take, *weights(rig, W=w.tolist()))
    total = np.tensordot(w, np.array(stored), 1)
    assert np.array_equal(picture[:, :, 0], picture[:, :, 1])
    assert np.array_equal(picture[:, :, 0], picture[:, :, 2])
    # 12 sums of floats
    assert np.allclose(picture[:550, :430, 0], total, rtol=3e-6, atol=3e-6 * total.max())
    lobby = relit(rig, take, harness.data("environments", "lobby.hdr"))
    assert np.all(np.isfinite(lobby)) and lobby.mean() > 0
    assert np.array_equal(lobby[:, :, 0], lobby[:, :, 2])


# ---- a real rig, captured environments ----

def test_a_real_rig_and_captured_environments_load_and_relight(folder):
    positions = harness.data(*REAL_RIG)
    rig = harness.rig_of(folder, size=96, positions=(positions, "left,up,away", "cm"), scene_extra=
                         f'positions = "{positions}"; axes = "left,up,away"; unit = "cm";').start()
    take = rig.start_take("real", """subject = "still"; exposures_us = [2500, 12500]; darks = 16;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B"]; },
               { kind = "each"; channels = ["W"]; } );""")
    document = rig.ask("take", "show", take)["take"]
    at = np.array(document["rig"]["lights"]["position_m"])
    rows = np.array([list(map(float, line.split(","))) for line in
                     harness.stage.read(positions).splitlines() if line[0] != "#"])
    assert at.shape == (346, 3)
    assert np.allclose(at, rows * [-0.01, 0.01, -0.01], atol=1e-6)
    assert np.array_equal(at[COINCIDENT[0]], at[COINCIDENT[1]])
    rig.control("fetch", take, "--channel", "W", "--lights", ",".join(map(str, COINCIDENT)),
                "--output", rig.path("same"))
    omega = [f["solid_angle_sr"] for f in json.loads(harness.stage.read(rig.path("same.json")))
             ["frames"]]
    assert abs(omega[0] / omega[1] - 1) < 1e-6, omega
    same = [pictures.read(rig.path(f"same.{i + 1:04d}.exr")) for i in COINCIDENT]
    # behind the subject: little of it is lit, what is differs by noise
    assert np.abs(same[0] - same[1]).mean() < 0.2 * max(np.abs(same[0]).mean(), 0.01)
    environments_relight(rig, take)
    white_is_the_sum_over_all_cells(rig, take, document)


def environments_relight(rig, take):
    for name in ("lobby", "park", "warehouse"):
        path = harness.data("environments", name + ".hdr")
        spectral = relit(rig, take, path)
        plain = relit(rig, take, path, "--solve", "tristimulus")
        for picture in (spectral, plain):
            assert np.all(np.isfinite(picture)), name
        grey = [p.reshape(-1, 3) @ LUMINANCE for p in (spectral, plain)]
        alike = np.corrcoef(*grey)[0, 1]
        level = grey[0].mean() / grey[1].mean()
        print(f"# {name}: spectral and tristimulus correlate {alike:.4f}, luminance {level:.3f}")
        # Demosaicing overshoots at the hard edges of so small a picture, which are below 5 % of it,
        # and colours outside Rec. 709 have a negative component. Surfaces are never dark beyond 0.
        dim = np.quantile(grey[0], 0.05) / np.quantile(grey[0], 0.99)
        assert dim > -0.01, (name, dim)
        # the same light on the same things: only metamers differ
        assert alike > 0.98 and 0.85 < level < 1.15, name


def white_is_the_sum_over_all_cells(rig, take, document):
    cal = document["calibration"]
    omega = cal["lights"]["omega_sr"]
    one = 255.5 / 256  # exact in RGBE, whose pixels stand for the middle of their step
    white = geometry.hdr(rig.path("white.hdr"), np.full((16, 32, 3), one))
    basis = np.array([relit(rig, take, *weights(rig, **{s: omega}), "--raw") for s in SPECTRA])
    raw = np.linalg.solve(cal["M"], [one] * 3)
    plain = relit(rig, take, white, "--solve", "tristimulus", "--raw")
    off = np.sqrt(np.mean((plain - basis[0] * raw / cal["p"]["W"]) ** 2) / np.mean(plain ** 2))
    # Both cut the same cells; the calibration's are counted with 200000 directions, 580 to a cell
    # whose border some 50 of them are near: a few directions, 0.5 % of a cell, and none of the sum.
    assert off < 0.002, off
    level = plain.mean(axis=(0, 1)) / (basis[0] * raw / cal["p"]["W"]).mean(axis=(0, 1))
    assert np.all(np.abs(level - 1) < 0.0005), level
    solved = relit(rig, take, white, "--raw")
    alpha, *_ = np.linalg.lstsq(basis.reshape(6, -1).T, solved.ravel(), rcond=None)
    rest = np.sqrt(np.mean((np.tensordot(alpha, basis, 1) - solved) ** 2) / np.mean(solved ** 2))
    print(f"# white map: tristimulus off {off:.6f}, level {level}, spectral alpha {np.round(alpha, 3)}, "
          f"rest {rest:.5f}")
    assert rest < 0.002, rest
    assert alpha.min() > -0.002, alpha  # NNLS, but for the same difference of the cells


# ---- what cannot be an environment ----

def test_environments_that_cannot_be_used_are_refused_with_a_sentence(folder):
    tool = harness.need("oiiotool")
    rig = harness.twelve(folder).start()
    take = rig.start_take("small", harness.PLAN)

    def create(name, *options):
        harness.stage.call(tool, "--create", "64x32", "3", "--fill:color=1,1,1", "64x32", *options,
                           "-o", rig.path(name))
        return rig.path(name)

    def refused(path, sentence):
        harness.refuses(sentence, lambda: rig.control("relight", take, path, "--output",
                                                      rig.path("never.exr")), 2)

    refused(create("aces.exr", "--attrib:type=float[8]", "chromaticities", ODD_PRIMARIES),
            "chromaticities other than Rec. 709")
    refused(create("dwa.exr", "--compression", "dwaa"), "--compression zip")
    refused(rig.path("sim.conf"), "expected a lat-long .hdr or .exr")
    refused(rig.path("absent.hdr"), "absent.hdr")
    good = geometry.hdr(rig.path("good.hdr"), np.ones((16, 32, 3)))
    with open(good, "rb") as file:
        whole = file.read()
    for change, sentence in (
            ((b"32-bit_rle_rgbe", b"32-bit_rle_xyze"), "xyze"),
            ((b"\n\n-Y", b"\nPRIMARIES= 0.7 0.3 0.2 0.7 0.1 0.1 0.33 0.33\n\n-Y"), "primaries"),
            ((b"-Y 16 +X 32", b"-Y 16 +X 33"), "truncated"), ((b"#?RADIANCE", b"#!RADIANCE"), "Radiance")):
        with open(rig.path("bad.hdr"), "wb") as file:
            file.write(whole.replace(*change))
        refused(rig.path("bad.hdr"), sentence)
    relit(rig, take, good)
    relit(rig, take, create("plain.exr"))
    relit(rig, take, create("rec709.exr", "--attrib:type=float[8]", "chromaticities",
                            "0.64,0.33,0.30,0.60,0.15,0.06,0.3127,0.3290"))


def test_damaged_environments_never_crash_the_client(folder):
    damaged = [path for path in glob.glob(os.path.join(harness.data("openexr", "Damaged"), "*"))
               if not path.endswith(".rst")]
    rig = harness.twelve(folder).start()
    take = rig.start_take("small", harness.PLAN)
    counts = {0: 0, 2: 0}
    for path in damaged:
        shutil.copy(path, rig.path("map.exr"))
        done = subprocess.run(
            [rig.program("clients/lightstagectl"), "--socket", rig.path("socket"), "relight", take,
             rig.path("map.exr"), "--output", rig.path("relit.exr")], timeout=120,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        assert done.returncode in counts, f"{path}: ended with {done.returncode}: {done.stderr}"
        if done.returncode == 2:
            assert "map.exr: " in done.stderr, f"{path}: {done.stderr}"
        counts[done.returncode] += 1
    print(f"# of {len(damaged)} damaged files {counts[2]} were refused, {counts[0]} could be read")
    assert counts[2] > 0.8 * len(damaged)


harness.main(globals())
