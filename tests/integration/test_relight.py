#!/usr/bin/python3 -B
"""Every way to ask for a relit picture, through the daemon: several at once, solves, captured light."""
import json

import numpy as np

import geometry
import harness
import pictures

LIGHTS = 40  # more than are summed at a time
PLAN = """subject = "still"; exposures_us = [500, 2500, 12500]; darks = 8;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B"]; },
               { kind = "each"; channels = ["W"]; } );"""


def photographed(folder, **options):
    rig = harness.rig_of(folder, size=128, scene_extra=f"lights = {LIGHTS};", **options).start()
    return rig, rig.start_take("small", PLAN)


def environment(rig, name, seed):
    """Light from everywhere, of another colour in each direction."""
    random = np.random.default_rng(seed)
    return geometry.hdr(rig.path(name), random.uniform(0.1, 1.2, (16, 32, 3)))


def relit(rig, take, *how, output="relit.exr"):
    said = json.loads(rig.control("relight", take, *how, "--output", rig.path(output), "--json"))
    return said, pictures.read(rig.path(output % 1 if "%" in output else output))


def one(rig, take, *how):
    return relit(rig, take, *how)[1]


def off(a, b):
    return np.sqrt(np.mean((a - b) ** 2) / np.mean(b ** 2))


def at_once_as_one_by_one(rig, take, maps, turns, *how):
    said, _ = relit(rig, take, *maps, "--rotate", ",".join(map(str, turns)), *how,
                    output="many-%02d.exr")
    assert said["passes"] == 1, said
    asked = [(m, t) for m in maps for t in turns]
    assert [(p["environment"], p["rotation"]) for p in said["pictures"]] == asked
    seen = []
    for number, (path, turn) in enumerate(asked, 1):
        name = rig.path(f"many-{number:02d}.exr")
        assert said["pictures"][number - 1]["output"] == name
        seen.append(pictures.read(name))
        alone = one(rig, take, path, "--rotate", str(turn), *how)
        assert np.array_equal(seen[-1], alone), (path, turn, how, off(seen[-1], alone))
    for k in range(1, len(seen)):  # they are different pictures
        assert off(seen[k], seen[0]) > 1e-3, (k, how)
    return said


def turning_the_stage_is_turning_the_map(rig, take, path):
    """By a column of texels: the same cells of a map that was moved beforehand."""
    columns = 32
    values = np.random.default_rng(5).uniform(0.1, 1.2, (16, columns, 3))
    geometry.hdr(path, values)
    turned = one(rig, take, path, "--rotate", str(360 / columns * 4))
    errors = {}
    for shift in (4, -4):
        geometry.hdr(rig.path("moved.hdr"), np.roll(values, shift, axis=1))
        errors[shift] = off(turned, one(rig, take, rig.path("moved.hdr")))
    print(f"# turned by 45 degrees against the map moved by columns: {errors}")
    # right-handed about y takes what is in front to the right, where columns grow to the left or
    # right by the map's convention: one of the two is the same light, the other is not
    assert min(errors.values()) < 1e-5 < 0.01 < max(errors.values()), errors


def options_do_what_they_say(rig, take, path):
    plain, base = relit(rig, take, path)
    assert plain["solve"]["mode"] == "shared" and plain["solve"]["space"] == "after-M", plain
    least, picture = relit(rig, take, path, "--method", "least-squares")
    # what may be negative could come nearer; its damping takes it as far away as that again
    assert 0.85 < least["solve"]["residual"] / plain["solve"]["residual"] < 1.15, (least, plain)
    assert 0 < off(picture, base) < 0.2, off(picture, base)
    smooth = one(rig, take, path, "--cells", "smooth")
    assert 1e-3 < off(smooth, base) < 0.2, off(smooth, base)
    level = smooth.mean() / base.mean()
    assert abs(level - 1) < 0.05, level  # the same light, otherwise shared
    paper = one(rig, take, path, "--profile", "paper", "--solve", "tristimulus")
    assert np.all(np.isfinite(paper)) and off(paper, one(rig, take, path, "--solve",
                                                         "tristimulus")) > 1e-3
    assert "chromaticities" in attributes(rig), attributes(rig).keys()
    targets, picture = relit(rig, take, path, "--solve", "per-target")
    assert targets["solve"]["mode"] == "per-target" and targets["passes"] == 1, targets
    assert off(picture, base) < 0.2, off(picture, base)


def attributes(rig):
    with open(rig.path("relit.exr"), "rb") as file:
        return pictures.header(file.read(), 8)[0]


def what_is_left_out_is_bounded(rig, take, path):
    exact, picture = relit(rig, take, path, "--raw")
    assert exact["error_bound"] == 0 and exact["tiles_skipped"] == 0, exact
    allowed = 0.02 * picture.max()
    said, skipped = relit(rig, take, path, "--raw", "--max-error", str(allowed), "--model", "sphere")
    worst = np.abs(skipped - picture).max()
    print(f"# allowed {allowed:.4f}, bound {said['error_bound']:.4f}, worst pixel {worst:.5f}, "
          f"{said['tiles_skipped']} tiles")
    assert said["tiles_skipped"] > 0 and 0 < said["error_bound"] <= allowed, said
    # the bound is before promotion; ratios of this dome's LEDs stay below 1
    assert 0 < worst <= said["error_bound"], (worst, said)


def test_several_environments_at_once_are_the_same_bits_as_one_by_one(folder):
    rig, take = photographed(folder)
    maps = [environment(rig, f"env{seed}.hdr", seed) for seed in (1, 2)]
    at_once_as_one_by_one(rig, take, maps, (0, 30, -75.5))
    at_once_as_one_by_one(rig, take, maps, (0, 90), "--solve", "tristimulus", "--raw")
    at_once_as_one_by_one(rig, take, maps, (0,), "--solve", "per-target")
    # more than one request holds: 60 pictures of 6 rows each
    said, _ = relit(rig, take, maps[0], "--rotate", ",".join(str(6 * k) for k in range(60)),
                    "--region", "32,32,32,32", output="turn-%03d.exr")
    assert said["passes"] == 2 and len(said["pictures"]) == 60, said["passes"]
    last = pictures.read(rig.path("turn-060.exr"))
    assert np.array_equal(last, one(rig, take, maps[0], "--rotate", "354", "--region",
                                    "32,32,32,32"))
    harness.refuses("a number in the name", lambda: relit(rig, take, *maps), 2)
    harness.refuses("expected degrees", lambda: relit(rig, take, maps[0], "--rotate", "0,,1"), 2)
    weights = []
    for k in (1, 2):
        weights += ["--weights", rig.path(f"w{k}.json")]
        harness.stage.write(weights[-1], json.dumps({"W": [0.1 * k + 0.01 * i
                                                           for i in range(LIGHTS)]}))
    relit(rig, take, *weights, output="by-weights-%d.exr")
    assert np.array_equal(pictures.read(rig.path("by-weights-2.exr")),
                          one(rig, take, *weights[2:]))


def test_a_relit_picture_follows_its_options(folder):
    rig, take = photographed(folder)
    path = environment(rig, "env.hdr", 3)
    options_do_what_they_say(rig, take, path)
    turning_the_stage_is_turning_the_map(rig, take, path)
    what_is_left_out_is_bounded(rig, take, path)


def captured(rig, strengths, level):
    """Even light of these LED strengths, as a ball and two charts show it."""
    cal = json.loads(harness.stage.read(rig.path("calibration.json")))
    names, reflectance = [c["name"] for c in cal["channels"]], np.array(cal["chart"]["reflectance"]["values"])
    chart = np.array(cal["L"]) @ [strengths.get(n, 0) for n in names]  # [patch][colour]
    neutral = int(np.argmin(reflectance.std(axis=1) / reflectance.mean(axis=1)))
    rho = float(reflectance[neutral].mean())
    side, radius = 128, 60
    ball = np.zeros((side, side, 3)) + level * chart[neutral] / rho
    geometry.hdr(rig.path("ball.hdr"), ball)
    path = rig.path("captured.json")
    harness.stage.write(path, json.dumps({
        "format": 1,
        "ball": {"picture": "ball.hdr", "centre_px": [side / 2, side / 2], "radius_px": radius,
                 "camera_direction": [0, 0, 1], "polariser": "none",
                 "reflectivity": [1, 1, 1], "blind_deg": 5},
        "neutrals": [{"patch": neutral, "reflectance": rho}],
        "charts": [{"normal": [0, 0, z], "rgb": chart.tolist()} for z in (1, -1)]}))
    return path, cal["lights"]["omega_sr"]


def test_captured_light_comes_back_as_the_strengths_it_was_made_of(folder):
    rig, take = photographed(folder)
    strengths, level = {"W": 0.5, "R": 0.4, "A": 0.1, "G": 0.3, "C": 0.2, "B": 0.6}, 0.7
    path, omega = captured(rig, strengths, level)
    said, picture = relit(rig, take, path, "--raw")
    weights = rig.path("weights.json")
    harness.stage.write(weights, json.dumps({n: [level * a * o for o in omega]
                                             for n, a in strengths.items()}))
    expected = one(rig, take, "--weights", weights, "--raw")
    print(f"# captured light: residual {said['solve']['residual']:.2e}, "
          f"picture off by {100 * off(picture, expected):.2f} %")
    # the ball's picture has steps of up to 0.8 % (RGBE), and the cells were measured differently
    assert said["solve"]["residual"] < 0.01, said
    assert off(picture, expected) < 0.015, off(picture, expected)


def test_a_monochrome_camera_sees_the_colours_of_the_environment_by_target(folder):
    rig, take = photographed(folder, cfa="mono", pixel_format="Mono12")
    red = geometry.hdr(rig.path("red.hdr"), np.full((16, 32, 3), (0.9, 0.3, 0.2)))
    said = at_once_as_one_by_one(rig, take, [environment(rig, "env.hdr", 4), red], (0, 45))
    for picture in said["pictures"]:
        assert picture["solve"]["mode"] == "per-target", picture
    baseline = one(rig, take, red, "--solve", "tristimulus")
    picture = one(rig, take, red)
    level = picture.mean(axis=(0, 1)) / baseline.mean(axis=(0, 1))
    print(f"# mono under red light: means {np.round(picture.mean(axis=(0, 1)), 3)}, "
          f"of the baseline's {np.round(level, 3)}")
    r, g, b = picture.mean(axis=(0, 1))
    assert r > 1.5 * g > 0 and r > 1.5 * b, (r, g, b)
    # the baseline has the light's colours and none of the things'
    mixed = [baseline[:, :, c] / baseline[:, :, 0].mean() for c in range(3)]
    assert np.allclose(mixed[1] / (0.3 / 0.9), mixed[0], rtol=0.02, atol=1e-3)
    grey = picture @ [0.2126, 0.7152, 0.0722], baseline @ [0.2126, 0.7152, 0.0722]
    assert np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1] > 0.9
    harness.refuses("--solve per-target", lambda: relit(rig, take, red, "--solve", "shared"), 2)


if __name__ == "__main__":
    harness.main(globals())
