#!/usr/bin/python3 -B
"""Lights photographed many at a time, decoded: less noise than alone where read noise rules, more
where shot noise does, by what theory says."""
import json
import os

import numpy as np

import harness
import pictures
import takes

LIGHTS, ORDER, DROOP = 18, 19, 1.2
ALL_LIGHTS, ALL_ORDER = 346, 347
FULL_WELL_E, READ_E, E_PER_DN = 10500, 5, 10500 / 4095
CHANNELS = '''channels = ( { name = "W"; kind = "spectrum"; spectrum = "white"; droop = 1.2; },
    { name = "R"; kind = "spectrum"; spectrum = "red"; droop = 1.2; } );'''
# Single lights of 3 and of 90 electrons in the mean
READ_US, SHOT_US = 50, 2400


def plan(kind, exposure_us, channels="W", level=""):
    names = ", ".join(f'"{c}"' for c in channels)
    return f"""subject = "still"; exposures_us = [{exposure_us}]; darks = 128;
conditions = ( {{ kind = "{kind}"; channels = [{names}]; {level} }} );"""


def calibrate(rig, channels="W", lights=LIGHTS, order=ORDER):
    """The factor of rows of mean brightness, at full duty: the supply's sag."""
    path = rig.path("calibration.json")
    cal = json.loads(harness.stage.read(path))
    lit = lights * (order + 1) / (2 * order)
    factor = 1 + (DROOP - 1) * (lit - 1) / (lights - 1)
    for channel in channels:
        cal["pattern_factors"].append({"channel": channel, "pattern": "multiplex", "duty": 1.0,
                                       "factor": factor})
    harness.stage.write(path, json.dumps(cal))
    return factor


def rig_of_eighteen(folder):
    rig = harness.rig_of(folder, size=96, channels="WR", scene_extra=f"lights = {LIGHTS}; {CHANNELS}")
    factor = calibrate(rig)
    return rig.start(), factor


def lights_of(rig, kind, exposure_us, lights=LIGHTS):
    """Estimates of every light as the daemon serves them, in electrons: (light, row, column)."""
    code, status, err = takes.photograph(rig, plan(kind, exposure_us))
    assert code == 0 and status["state"] == "complete", err
    prefix = rig.path("light")
    answer = rig.ask("fetch", status["id"], "--channel", "W", "--layout", "mosaic", "--estimate",
                     "--output", prefix)
    document = takes.document(rig, status["id"])
    electrons = FULL_WELL_E * document["exposure_s"][0] / document["reference_exposure_s"]
    stack = [pictures.read(f"{prefix}.{i + 1:04d}.exr")[:, :, 0] for i in range(lights)]
    return electrons * np.array(stack), json.dumps(answer), status["id"]


def noise(pair, good):
    """Of one of two takes alike."""
    return np.sqrt(np.mean((pair[0][:, good] - pair[1][:, good]) ** 2) / 2)


def compare(rig, factor, exposure_us, lights=LIGHTS, order=ORDER):
    """Noise of lights alone over noise of lights decoded: (measured, by theory)."""
    alone = [lights_of(rig, "each", exposure_us, lights)[0] for _ in range(2)]
    answers = [lights_of(rig, "multiplex", exposure_us, lights) for _ in range(2)]
    decoded = [a[0] for a in answers]
    assert all('"spare_alarm": false' in a[1] for a in answers), answers[0][1][:600]
    assert all(f'"multiplexed": {order}' in a[1] for a in answers)
    mean_e = np.mean(alone, axis=0)
    # what a row shows is at most the sum; beyond 0.8 of full it may saturate
    good = (mean_e.sum(axis=0) < 0.8 * FULL_WELL_E) & (mean_e.max(axis=0) < 0.8 * FULL_WELL_E)
    assert good.mean() > 0.5, good.mean()
    variance = READ_E ** 2 + E_PER_DN ** 2 / 12
    e = np.mean(mean_e[:, good])
    theory = np.sqrt((variance + e) / (factor ** 2 * 4 * order / (order + 1) ** 2 * variance +
                                       factor * 2 * lights / (order + 1) * e))
    measured = noise(alone, good) / noise(decoded, good)
    off = np.mean((np.mean(decoded, axis=0) - mean_e)[:, good], axis=1) / e
    print(f"# {exposure_us} us, {e:.1f} e per light, {100 * good.mean():.0f} % of pixels: gain "
          f"{measured:.3f}, by theory {theory:.3f}; lights off by at most "
          f"{100 * np.abs(off).max():.2f} %", flush=True)
    return measured, theory, np.abs(off).max()


def test_decoding_wins_where_read_noise_rules_and_loses_where_shot_noise_does(folder):
    rig, factor = rig_of_eighteen(folder)
    dim, dim_theory, _ = compare(rig, factor, READ_US)
    bright, bright_theory, off = compare(rig, factor, SHOT_US)
    # 18 lights of at least 4600 pixels each, two takes: noise is known to 0.5 %; dark current,
    # PRNU that differs between pixels and what 128 darks leave in both change the ratio by 2 %.
    assert dim > 1.4 and abs(dim / dim_theory - 1) < 0.05, (dim, dim_theory)
    assert bright < 0.85 and abs(bright / bright_theory - 1) < 0.05, (bright, bright_theory)
    # The mean of a light, of the mean of all: 13 electrons of noise at a pixel, 18000 samples, so
    # 0.1 %; a factor of the pattern left out shows 10 %, a swapped row more.
    assert off < 0.01, off


def test_of_346_lights_each_is_decoded_with_the_noise_that_theory_leaves(folder):
    if "LS_TEST_FULL" not in os.environ:
        raise harness.Skip("half a minute; LS_TEST_FULL runs it, and of 18 lights it always runs")
    # a tenth of the light: 0.3 electrons of a light alone, 50 of a row
    rig = harness.rig_of(folder, size=64, channels="W", camera_extra="white_exposure_us = 40000;",
                         scene_extra=f"lights = {ALL_LIGHTS}; " + CHANNELS.split(",\n")[0] + " );")
    factor = calibrate(rig, "W", ALL_LIGHTS, ALL_ORDER)
    rig.start()
    gain, theory, _ = compare(rig, factor, READ_US, ALL_LIGHTS, ALL_ORDER)
    # as for eighteen lights, of 346 pictures of 4096 pixels
    assert gain > 4 and abs(gain / theory - 1) < 0.05, (gain, theory)


def test_a_row_of_174_lights_is_as_bright_as_the_current_allows(folder):
    # half of what they draw at full duty
    rig = harness.rig_of(folder, size=64, channels="W",
                         controller_extra="max_current_ma = 60900;",
                         scene_extra=f"lights = {ALL_LIGHTS}; " + CHANNELS.split(",\n")[0] + " );")
    rig.start()
    bright = takes.plan_file(rig, plan("multiplex", 100, level="level = 65535;"))
    code, _, err = takes.ask(rig, "preflight", "--plan", bright)
    assert code == 6, (code, err)
    takes.says(err, "current 121800 mA", "60900 mA")
    code, status, err = takes.photograph(rig, plan("multiplex", 100).replace("128", "4"))
    assert code == 0 and status["state"] == "complete", err
    rows = [c for c in takes.document(rig, status["id"])["plan"]["conditions"] if c.get("pattern")]
    assert len(rows) == ALL_ORDER and {c["level"] for c in rows} == {65535 * 60900 // 121800}, rows[0]
    assert rig.judge(status["id"])["frames_mislabeled"] == 0
    client = takes.begin(rig, plan("multiplex", 100), wait=True)
    takes.fire(rig, 650)  # 380 of the first take, then 133 of warm-up and darks
    takes.interrupt(client)
    assert client.wait(30) == 130
    rig.stop()
    rig.controller_extra = "max_current_ma = 50000;"
    rig.write_simulator("")
    rig.start()
    code, _, err = takes.resume(rig, rig.takes()[-1]["id"])
    assert code == 5, (code, err)
    takes.says(err, "multiplex-W-0000 was lit at level 32767", "current limit has changed")


def test_polarised_lights_multiplexed_relight_as_those_photographed_alone(folder):
    channels = CHANNELS.replace(" );", ''',
    { name = "V"; kind = "vertical"; spectrum = "white"; droop = 1.2; },
    { name = "H"; kind = "horizontal"; spectrum = "white"; droop = 1.2; } );''')
    rig = harness.rig_of(folder, size=96, channels="WRVH", scene_extra=f"lights = {LIGHTS}; {channels}")
    calibrate(rig, "VH")
    rig.start()
    environment = os.path.join(harness.ROOT, "sim", "environment.json")
    picture, single = [], []
    for kind in ("each", "multiplex"):
        text = plan(kind, SHOT_US, "VH").replace("} );", '}, { kind = "sphere"; channels = ["R"]; } );')
        code, status, err = takes.photograph(rig, text)
        assert code == 0 and status["state"] == "complete", err
        answer = rig.ask("relight", status["id"], environment, "--raw", "--output",
                         rig.path("relit.exr"))
        assert ("multiplexed" in json.dumps(answer)) == (kind == "multiplex"), answer
        picture.append(pictures.read(rig.path("relit.exr")))
        for channel in "VH":
            prefix = rig.path(kind + channel)
            rig.control("fetch", status["id"], "--channel", channel, "--output", prefix)
            single.append([pictures.read(f"{prefix}.{i + 1:04d}.exr").mean() for i in range(LIGHTS)])
    # means over 9216 pixels, as of white lights above; one light's, of noise sqrt 2 as much
    both = [p.mean(axis=(0, 1)) for p in picture]
    print(f"# relit: {both[0]} light by light, {both[1]} multiplexed", flush=True)
    assert np.allclose(both[0], both[1], rtol=0.02), both
    single = np.array(single)
    assert not np.allclose(single[0], single[1], rtol=0.02), "V and H differ"
    assert np.allclose(single[:2], single[2:], rtol=0.02, atol=0.01 * single.mean()), single
    code, _, err = takes.ask(rig, "relight", status["id"], environment, "--model", "separated",
                             "--output", rig.path("x.exr"))
    assert code == 7 and "V" in err and "one by one" in err, (code, err)


def test_a_multiplexed_take_relights_as_one_photographed_light_by_light(folder):
    rig, _ = rig_of_eighteen(folder)
    environment = os.path.join(harness.ROOT, "sim", "environment.json")
    picture = []
    for kind in ("each", "multiplex"):
        more = '{ kind = "sphere"; channels = ["R"]; }'
        text = plan(kind, SHOT_US).replace("} );", "}, " + more + " );")
        code, status, err = takes.photograph(rig, text)
        assert code == 0 and status["state"] == "complete", err
        rig.control("relight", status["id"], environment, "--raw", "--output",
                    rig.path("relit.exr"))
        picture.append(pictures.read(rig.path("relit.exr")))
    both = [p.mean(axis=(0, 1)) for p in picture]
    print(f"# relit: {both[0]} light by light, {both[1]} multiplexed", flush=True)
    # noise of 9216 pixels averaged; saturated highlights differ between the two (0.1 % of pixels)
    assert np.allclose(both[0], both[1], rtol=0.02), both


def test_preflight_says_when_multiplexing_wins(folder):
    rig, factor = rig_of_eighteen(folder)

    def said(level):
        text = takes.plan_file(rig, plan("multiplex", READ_US, level=level))
        lines = rig.ask("preflight", "--plan", text)["warnings"].splitlines()
        return [line for line in lines if line.startswith("multiplex of W, camera 0")]

    read = (READ_E / E_PER_DN) ** 2 + 1 / 12
    gained = read * (1 - factor ** 2 * 4 * ORDER / (ORDER + 1) ** 2)
    even = gained / ((factor * 2 * LIGHTS / (ORDER + 1) - 1) / E_PER_DN)
    gain = (ORDER + 1) / (2 * np.sqrt(ORDER) * factor)
    words = said("")
    assert len(words) == 1 and "wins where a light alone reads less than" in words[0], words
    number = float(words[0].split("less than ")[1].split(" DN")[0])
    assert abs(number / even - 1) < 0.01, (words, even)
    assert f"gain {gain:.2f} at black" in words[0], (words, gain)
    tenth = said("level = 6553;")
    assert "never wins" in tenth[0], tenth  # a tenth of the light, a tenth of the signal


if __name__ == "__main__":
    harness.main(globals())
