#!/usr/bin/python3 -B
"""One take that holds everything: every model of promotion serves it, near what is true."""
import json

import numpy as np

import harness
import pictures

LIGHTS = 40
PLAN = """subject = "still"; exposures_us = [500, 2500, 12500]; darks = 16;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "B"]; },
               { kind = "segments"; channels = ["A", "G", "B"]; count = 8; },
               { kind = "headlight"; channels = ["A", "G", "B"]; },
               { kind = "each"; channels = ["W", "R", "V", "H"]; } );"""
MODELS = ("sphere", "headlight", "separated", "linear")


def factor(rig, channel, n_lit, duty):
    """What the simulator's supply and dimmer make of a pattern (sim/scene.c)."""
    droop = 1 + ((1.14 if channel == "A" else 1.20) - 1) * (n_lit - 1) / (LIGHTS - 1)
    return duty * droop / (np.floor(duty * 1000 + 0.5) / 1000)


def calibrate_patterns(rig, take):
    """Give the take's own calibration the factors of every pattern it photographed."""
    path = rig.path(f"takes/{take}/take.json")
    document = json.loads(harness.stage.read(path))
    factors = {}
    for c in document["plan"]["conditions"]:
        if c.get("pattern"):
            n, duty = len(c.get("lights", range(LIGHTS))), c["level"] / 65535
            factors[c["channel"], c["pattern"], duty] = factor(rig, c["channel"], n, duty)
    document["calibration"]["pattern_factors"] = [
        {"channel": c, "pattern": p, "duty": d, "factor": f} for (c, p, d), f in factors.items()]
    harness.stage.write(path, json.dumps(document))
    return document


def everything(folder, **options):
    rig = harness.rig_of(folder, size=128,
                         scene_extra=f"lights = {LIGHTS}; gain_sigma = 0.05;", **options).start()
    take = rig.start_take("everything", PLAN)
    return rig, take, calibrate_patterns(rig, take)


def seen(picture):
    """Of each pixel the colour its filter let through, which demosaicing keeps (RGGB)."""
    mosaic = picture[:, :, 1].copy()
    mosaic[::2, ::2] = picture[::2, ::2, 0]
    mosaic[1::2, 1::2] = picture[1::2, 1::2, 2]
    return mosaic


def difference(ours, true):
    """Relative RMS in percent, of lists of pictures against mosaics; without the highlights, which
    saturate."""
    ours, true = np.array([seen(p) for p in ours]), np.array([t[:, :, 0] for t in true])
    dim = true < 1
    return 100 * np.sqrt(np.sum((ours - true)[dim] ** 2) / np.sum(true[dim] ** 2))


def filtered(mosaic, kernel):
    """Sum of a 5 x 5 neighbourhood, mirrored at the border."""
    padded, out = np.pad(mosaic, 2, mode="reflect"), np.zeros_like(mosaic)
    for y, row in enumerate(kernel):
        for x, weight in enumerate(row):
            out += weight / 16 * padded[y:y + mosaic.shape[0], x:x + mosaic.shape[1]]
    return out


def demosaiced(mosaic):
    """What core/demosaic.h makes of RGGB: Malvar, He and Cutler (2004)."""
    green = filtered(mosaic, [[0, 0, -2, 0, 0], [0, 0, 4, 0, 0], [-2, 4, 8, 4, -2],
                              [0, 0, 4, 0, 0], [0, 0, -2, 0, 0]])
    kernel = np.array([[0, 0, 1, 0, 0], [0, -2, 0, -2, 0], [-2, 8, 10, 8, -2],
                       [0, -2, 0, -2, 0], [0, 0, 1, 0, 0]])
    beside, between = filtered(mosaic, kernel), filtered(mosaic, kernel.T)
    across = filtered(mosaic, [[0, 0, -3, 0, 0], [0, 4, 0, 4, 0], [-3, 0, 12, 0, -3],
                               [0, 4, 0, 4, 0], [0, 0, -3, 0, 0]])
    out = np.stack([mosaic] * 3, axis=2)
    for y, x, red, blue in ((0, 0, None, across), (0, 1, beside, between),
                            (1, 0, between, beside), (1, 1, across, None)):
        here = (slice(y, None, 2), slice(x, None, 2))
        for c, values in ((0, red), (1, green if x == y else None), (2, blue)):
            if values is not None:
                out[here][..., c] = values[here]
    return out


def fetched(rig, take, channel, model, lights, *options):
    prefix = rig.path(f"{channel}-{model}")
    said = json.loads(rig.control("fetch", take, "--channel", channel, "--lights",
                                  ",".join(map(str, lights)), "--model", model, "--layout", "rgb",
                                  "--output", prefix, "--json", *options))
    return [pictures.read(f"{prefix}.{i + 1:04d}.exr") for i in lights], said["spectra"][0]


def truth(rig, channel, lights):
    rig.simulator("field", "--lights", ",".join(map(str, lights)), "--channels", channel,
                  "--mosaic", "--output", rig.folder)
    return [pictures.read(rig.path(f"{channel}.{i + 1:04d}.exr")) for i in lights]


def front(document, n=8):
    """Lights that shine on what the camera sees."""
    position = np.array(document["rig"]["lights"]["position_m"])
    return sorted(int(i) for i in np.argsort(-position @ [0, 0.5, 1])[:n])


def test_every_model_serves_single_lights_near_the_truth(folder):
    rig, take, document = everything(folder)
    lights = front(document)
    error, said = {}, {}
    for model in MODELS:
        for channel in ("A", "G", "B"):
            ours, said[model, channel] = fetched(rig, take, channel, model, lights)
            error[model, channel] = difference(ours, truth(rig, channel, lights))
    measured, _ = fetched(rig, take, "R", "measured", lights)
    photographed = difference(measured, truth(rig, "R", lights))
    mean = {m: np.mean([error[m, c] for c in ("A", "G", "B")]) for m in MODELS}
    left_out = {c: 100 * said["linear", c]["left_out_error"] for c in ("A", "G", "B")}
    print(f"# single lights, percent: photographed {photographed:.2f}, "
          + ", ".join(f"{m} {mean[m]:.2f}" for m in MODELS)
          + "; left out: " + ", ".join(f"{c} {v:.2f}" for c, v in left_out.items()))
    # one frame's noise, 1.9 % here; what a model makes of light that depends on its direction: Eq. 1
    # 7.0 %, with the coats apart 7.1, of lights that are themselves in front by the head light 4.3,
    # fitted 2.9. A quarter more for other compilers' rounding and the sensor's other numbers.
    assert photographed < 2.4, photographed
    assert mean["sphere"] < 8.8 and mean["separated"] < 8.8, mean
    assert mean["headlight"] < 5.4, mean
    assert mean["linear"] < 0.55 * mean["sphere"], mean
    for (model, channel), s in said.items():
        assert s["model"] == model and s["channel"] == channel, s
        assert s["reference"] == "strengths", s
    assert said["linear", "A"]["segments"] == 8
    # R was photographed under each light: nothing to fit
    same, selected = fetched(rig, take, "R", "linear", lights[:1])
    assert selected["model"] == "measured", selected
    assert np.array_equal(same[0], measured[0])


def test_what_is_left_out_tells_the_error_of_every_light(folder):
    """Of all three colours of a pixel: two of them the demosaic has made, and promotion of what it
    made of a highlight is five times as far off as of what the sensor saw (3 %)."""
    rig, take, document = everything(folder)
    for channel in ("A", "G", "B"):
        ours, said = fetched(rig, take, channel, "linear", range(LIGHTS))
        true = [demosaiced(t[:, :, 0]) for t in truth(rig, channel, range(LIGHTS))]
        square = sum(np.sum((o[:, :, :3] - t) ** 2) for o, t in zip(ours, true))
        error = np.sqrt(square / sum(np.sum(t ** 2) for t in true))
        print(f"# {channel}: {100 * error:.2f} %, estimated {100 * said['left_out_error']:.2f} %")
        assert error / 1.5 < said["left_out_error"] < 1.5 * error, (channel, error, said)


def test_every_model_relights_near_the_truth(folder):
    rig, take, document = everything(folder)
    random = np.random.default_rng(3)
    omega = np.array(document["calibration"]["lights"]["omega_sr"])
    position = np.array(document["rig"]["lights"]["position_m"])
    # light from the left, bluish from the right: unlike the full sphere
    side = np.clip(-position[:, 0], 0, None)
    weights = {"W": list(omega * 0.1 * random.uniform(0.5, 1.5, LIGHTS)), "R": list(omega * side),
               "A": list(omega * side), "B": list(omega * np.clip(position[:, 0], 0, None))}
    path = rig.path("weights.json")
    harness.stage.write(path, json.dumps(weights))
    rig.simulator("relit", "--weights", path, "--mosaic", "--output",
                  rig.path("true.exr"))
    true = pictures.read(rig.path("true.exr"))
    error = {}
    for model, options in [(m, ()) for m in MODELS] + [
            ("sphere paper", ("--reference", "paper")),
            ("separated ideal", ("--ideal-polarisation",)),
            ("separated plain", ("--plain-conductors",))]:
        said = json.loads(rig.control("relight", take, "--weights", path, "--raw", "--model",
                                      model.split()[0], *options, "--output",
                                      rig.path("relit.exr"), "--json"))
        error[model] = difference([pictures.read(rig.path("relit.exr"))], [true])
        used = {s["channel"]: (s["model"], s["reference"]) for s in said["spectra"]}
        reference = "paper" if "paper" in model else "strengths"
        assert used["W"] == ("measured", "none"), used
        assert used["A"] == (model.split()[0], reference), used
        assert used["R"][0] == ("measured" if model == "linear" else model.split()[0]), used
    print("# relit, percent: " + ", ".join(f"{m} {e:.3f}" for m, e in error.items()))
    # 4.5, 4.5 and 4.3 %; fitted 1.3
    assert error["sphere"] < 5.5 and error["separated"] < 5.5 and error["headlight"] < 5.5, error
    assert error["linear"] < 0.4 * error["sphere"], error
    # 5 % between the lights of two spectra: F / F0 has them twice, ours once and known
    assert error["sphere"] < error["sphere paper"], error
    harness.refuses("kind \"each\"", lambda: rig.control(
        "relight", take, "--weights", path, "--raw", "--model", "measured", "--output",
        rig.path("relit.exr")), 5)


def test_a_take_says_what_a_model_lacks_and_what_it_offers(folder):
    rig, take, document = everything(folder)
    path = rig.path(f"takes/{take}/take.json")

    def fetch(channel, model, *options):
        return lambda: rig.control("fetch", take, "--channel", channel, "--lights", "0",
                                   "--model", model, "--layout", "rgb", "--output",
                                   rig.path("refused"), *options)

    harness.refuses('kind "segments"', fetch("C", "linear"), 5)
    harness.refuses("for A it offers model sphere, model headlight, model separated, model linear",
                    fetch("A", "measured"), 5)
    harness.refuses("never promoted; for V it offers model measured", fetch("V", "sphere"), 4)
    harness.refuses("belongs to model sphere", fetch("A", "linear", "--reference", "paper"), 4)
    document["calibration"]["pattern_factors"] = [
        f for f in document["calibration"]["pattern_factors"] if f["pattern"] == "sphere"]
    harness.stage.write(path, json.dumps(document))
    rig.daemon.stop()
    rig.start_daemon()
    harness.refuses("uncalibrated for segment-A", fetch("A", "linear"), 7)
    harness.refuses("uncalibrated for headlight-A", fetch("A", "headlight"), 7)
    harness.refuses("for A it offers model sphere, model separated", fetch("A", "linear"), 7)


if __name__ == "__main__":
    harness.main(globals())
