#!/usr/bin/python3 -B
"""lightstagectl calibrate: an operator's session, what it measures, and what it refuses."""
import json
import os
import subprocess

import numpy as np

import harness
import takes
from harness import stage

import calibrate as operator

LIGHTS = 48
CHANNELS = """channels = ( { name = "W"; kind = "spectrum"; spectrum = "white"; droop = 1.2; },
    { name = "R"; kind = "spectrum"; spectrum = "red"; droop = 1.15; },
    { name = "V"; kind = "vertical"; spectrum = "white"; droop = 1.1; },
    { name = "H"; kind = "horizontal"; spectrum = "white"; droop = 1.1; } );"""
WHITE = 'channels = ( { name = "W"; kind = "spectrum"; spectrum = "white"; droop = 1.2; } );'
GREY = """subject = "still"; exposures_us = [12000]; darks = 4;
conditions = ( { kind = "sphere"; channels = ["W"]; }, { kind = "each"; channels = ["W"]; } );
"""


def dome(folder, scene, channels=CHANNELS, names="WRVH", lights=LIGHTS, **options):
    return harness.rig_of(folder, size=256, scene=scene, channels=names,
                          scene_extra=f"lights = {lights}; {channels}",
                          **{"region": (128, 128), **options})


def given(rig):
    with open(rig.path("calibration.json"), encoding="utf-8") as file:
        return json.load(file)


def test_an_operator_is_asked_for_three_objects_and_gets_a_calibration(folder):
    rig = dome(folder, "grey").start()
    out = rig.path("measured.json")
    client = subprocess.Popen(
        takes.ctl(rig, "calibrate", "--output", out, "--json", *operator.EXPOSURES,
                  "--segments", "6"),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=stage.die_with_parent)
    said = operator.answer(rig, client)
    report = json.loads(client.stdout.read() or "{}")
    assert client.wait() == 0, said
    for object_ in ("the grey sphere", "the chrome ball", "the black glossy sphere"):
        assert f"Put {object_} at the stage's centre" in said, said
    with open(out, encoding="utf-8") as file:
        m = json.load(file)
    truth = given(rig)
    # It stands there exactly. Its outline is millimetres off along the view; the shading of 48
    # lights says better than 0.1 mm, after as many steps as that takes (one leaves 0.3 mm).
    assert report["residuals"]["grey sphere from the centre"] < 0.2, report["residuals"]
    flagged = {i for lights in m["lights"]["flags"].values() for i in lights}
    sure = [i for i in range(LIGHTS) if i not in flagged]
    assert len(sure) > LIGHTS / 2, flagged
    for s in "WRVH":
        error = np.array([m["k"][s][i] / truth["k"][s][i] - 1 for i in sure])
        print(f"# {s}: k {100 * np.sqrt(np.mean(error ** 2)):.3f} % rms, "
              f"{100 * abs(error).max():.3f} % worst")
        # a sphere of 36 px radius in one exposure, against 48 lights' own spread of 5 %
        assert np.sqrt(np.mean(error ** 2)) < 0.005, (s, error)
    off = [operator.angle(m["lights"]["measured_direction"][i], truth["lights"]["direction"][i])
           for i in sure]
    assert operator.rms(off) < 0.5, off
    factors = {(f["channel"], f["pattern"]): f for f in m["pattern_factors"]}
    assert set(p for _, p in factors) == {"sphere", "segments-6", "headlight"}, factors
    for (channel, pattern), f in factors.items():
        lit = {"sphere": LIGHTS, "segments-6": LIGHTS / 6, "headlight": 3}[pattern]
        droop = 1 + {"W": 0.2, "R": 0.15, "V": 0.1, "H": 0.1}[channel] * (lit - 1) / (LIGHTS - 1)
        driven = round(f["duty"] * 1000) / 1000
        # what a calibration promises of a factor
        assert abs(f["factor"] / (droop * f["duty"] / driven) - 1) < 0.005, f
    assert m["provenance"]["date"] and [t["subject"] for t in m["provenance"]["takes"]] == [
        "grey sphere", "chrome ball", "black glossy sphere"], m["provenance"]
    assert m["chart"]["names"] == truth["chart"]["names"] and "M" in m, "carried over"
    assert m["camera"]["hot_pixels"] == truth["camera"]["hot_pixels"], "carried over"
    # written with nine digits
    assert abs(m["camera"]["electrons_per_dn"] / truth["camera"]["electrons_per_dn"] - 1) < 1e-8
    a = np.array(m["polarisation"]["a_v"][0]) + np.array(m["polarisation"]["a_h"][0])
    assert np.all(abs(a - 1) < 1e-5), a
    assert report["residuals"]["a_V against the half vector, rms"] < 0.05, report
    assert report["residuals"]["chrome ball against shading, rms"] < 2, report
    assert report["file"] == out and report["verdict"], report
    rig.stop()
    rig.calibration = "measured.json"
    rig.start()
    plan = rig.ask("preflight", "--plan", takes.plan_file(rig, harness.PLAN.replace(
        '["W", "R", "A", "G", "C", "B"]', '["W", "R"]')))
    assert "calibrated" not in plan["warnings"], plan



def calibrate(rig, *options):
    return takes.ask(rig, "calibrate", "--output", rig.path("measured.json"), "--no-gloss",
                     "--segments", "0", "--yes", "--darks", "4", *options)


def refused(rig, *options):
    """Calibrate and be refused, as an answer; nothing is written."""
    code, out, err = calibrate(rig, *options)
    assert code == 1 and not out, (code, out, err)
    assert not os.path.exists(rig.path("measured.json"))
    return err


def test_a_chrome_ball_or_a_black_sphere_is_no_grey_one(folder):
    for scene in ("chrome", "gloss"):
        home = os.path.join(folder, scene)
        os.mkdir(home)
        rig = dome(home, scene, WHITE, "W", 24).start()
        err = refused(rig, "--grey-exposures", "12000")
        print("#", err.strip().splitlines()[-1])
        takes.says(err, "grey sphere")
        rig.stop()


def test_a_grey_sphere_is_no_chrome_ball_and_no_black_one_without_polarisers(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    code, status, err = takes.photograph(rig, GREY)
    assert code == 0, err
    err = refused(rig, "--grey", status["id"], "--chrome", status["id"])
    print("#", err.strip().splitlines()[-1])
    takes.says(err, "put the chrome ball there")
    code, _, err = takes.ask(rig, "calibrate", "--output", rig.path("measured.json"), "--grey",
                             status["id"], "--gloss", status["id"])
    assert code == 2 and "no pair of them" in err, (code, err)
    assert not os.path.exists(rig.path("measured.json"))


def test_a_sphere_that_is_too_bright_or_cut_off_is_named(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    takes.says(refused(rig, "--grey-exposures", "60000"), "saturated", "shorter exposures")
    rig.stop()
    cut = os.path.join(folder, "cut")
    os.mkdir(cut)
    rig = dome(cut, "grey", WHITE, "W", 24, region=(56, 56)).start()
    takes.says(refused(rig, "--grey-exposures", "12000"), "sphere", "whole")


def test_a_sphere_of_another_radius_is_told_its_own(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    code, status, err = takes.photograph(rig, GREY)
    assert code == 0, err
    takes.says(refused(rig, "--grey", status["id"], "--radius", "0.12"), "if its radius is 120 mm",
               "were it 100 mm")


def test_a_take_without_all_lights_cannot_calibrate(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    code, status, err = takes.photograph(rig, GREY.replace('kind = "each";',
                                                           'kind = "each"; lights = [0, 1, 2];'))
    assert code == 0, err
    takes.says(refused(rig, "--grey", status["id"]), "does not show every light", 'kind "each"')


def test_ctrl_c_leaves_the_stage_dark_names_the_take_and_writes_nothing(folder):
    rig = dome(folder, "grey").start()
    client = subprocess.Popen(
        takes.ctl(rig, "calibrate", "--output", rig.path("measured.json"), "--yes", "--no-gloss"),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=stage.die_with_parent)
    takes.fire(rig, 150)  # of 600; warm-up and darks are 53
    takes.interrupt(client)
    out, err = client.communicate(timeout=30)
    fired = takes.exposures(rig)
    take, = rig.takes()
    assert client.returncode == 130 and not out, (client.returncode, out, err)
    takes.says(err, "waiting for the lights to be dark", take["id"] + ": aborted", "LEDs are dark")
    lights = takes.lights_status(rig)
    assert lights["state"] == "loaded" and not lights["faults"], lights
    assert not os.path.exists(rig.path("measured.json"))
    # what is there of it calibrates nothing, and says what would
    code, _, err = takes.ask(rig, "calibrate", "--output", rig.path("measured.json"), "--grey",
                             take["id"])
    assert code == 7 and takes.exposures(rig) == fired, (code, err)
    takes.says(err, take["id"] + " lacks", "resume")
    assert not os.path.exists(rig.path("measured.json"))
    code, status, err = takes.resume(rig, take["id"])
    assert code == 0 and status["state"] == "complete", err
    code, _, err = takes.ask(rig, "calibrate", "--output", rig.path("measured.json"), "--grey",
                             take["id"])
    assert code == 0 and os.path.exists(rig.path("measured.json")), err


def test_an_incomplete_take_is_promoted_by_no_model_and_says_what_it_lacks(folder):
    rig = dome(folder, "stilllife").start()
    plan = GREY.replace('["W"]; },', '["W", "R"]; }, { kind = "segments"; count = 14; '
                        'channels = ["R"]; }, { kind = "headlight"; channels = ["R"]; },')
    client = takes.begin(rig, plan, wait=True)
    takes.fire(rig, 30)  # of 74; spheres, segments and head light are there, of the lights some
    takes.interrupt(client)
    assert client.wait(30) == 130
    take, = rig.takes()
    for model in ("sphere", "headlight", "linear"):
        code, _, err = takes.ask(rig, "fetch", take["id"], "--channel", "R", "--model", model,
                                 "--layout", "rgb", "--output", rig.path("x"))
        print("#", model, code, err.strip())
        assert code == 7 and "resume" in err, (model, code, err)
    assert not os.path.exists(rig.path("x.json"))


def test_a_take_that_names_no_patterns_calibrates_too(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    code, status, err = takes.photograph(rig, GREY.replace(
        "conditions = (", 'conditions = ( { kind = "segment"; channels = ["W"]; level = 9000; '
        "lights = [3, 5, 7]; },"))
    assert code == 0, err
    path = os.path.join(takes.folder(rig, status["id"]), "take.json")
    document = json.loads(stage.read(path))
    for condition in document["plan"]["conditions"]:
        condition.pop("pattern", None)
    stage.write(path, json.dumps(document))
    code, out, err = calibrate(rig, "--grey", status["id"], "--json")
    assert code == 0, err
    assert {f["pattern"] for f in json.loads(out)["factors"]} == {"sphere", "lights-3"}, out


def test_a_second_camera_sees_lights_that_the_first_does_not(folder):
    rig = dome(folder, "grey", WHITE, "W", LIGHTS, cameras=2).start()
    code, status, err = takes.photograph(rig, GREY)
    assert code == 0, err
    truth, flagged = given(rig), []
    for cameras in "0", "0,1":
        code, _, err = calibrate(rig, "--grey", status["id"], "--camera", cameras)
        assert code == 0, err
        with open(rig.path("measured.json"), encoding="utf-8") as file:
            m = json.load(file)
        flagged.append({i for lights in m["lights"]["flags"].values() for i in lights})
        off = [abs(m["k"]["W"][i] / truth["k"]["W"][i] - 1) for i in range(LIGHTS)
               if i not in flagged[-1]]
        print(f"# cameras {cameras}: {len(off)} lights without a flag, k worst {100 * max(off):.3f} %")
        # what a calibration promises, though 48 lights leave the mean of all as uncertain as 5 %
        # over the unseen: 0.2 % at one camera
        assert max(off) < 0.005, off
    assert flagged[1] < flagged[0], flagged
    code, _, err = calibrate(rig, "--grey", status["id"], "--camera", "0,2")
    takes.says(err, "camera 2", "the take has cameras 0 to 1")
    truth["camera"]["pixel_format"] = "BayerRG8"
    stage.write(rig.path("base.json"), json.dumps(truth))
    code, _, err = calibrate(rig, "--grey", status["id"], "--base", rig.path("base.json"))
    assert code, err
    takes.says(err, "of BayerRG8, the take is in BayerRG12", "base of this camera")


def test_nobody_to_answer_is_said(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    code, _, err = takes.ask(rig, "calibrate", "--output", rig.path("measured.json"))
    assert code == 1, (code, err)
    takes.says(err, "Put the grey sphere", "--yes")
    assert not rig.takes()


def test_wrong_command_lines_are_refused_before_a_light_is_lit(folder):
    rig = dome(folder, "grey", WHITE, "W", 24).start()
    for options, sentence in ((("--radius", "far"), "expected metres"),
                              (("--camera", "0,front"), "a camera's number"),
                              (("--grey-exposures", "soon"), "expected microseconds"),
                              (("--base", rig.path("absent.json")), "absent.json"),
                              (("--chrome", "x"), "--grey TAKE"),
                              (("--yes", "--segments", "25"), "the rig has 24 lights"),
                              (("--yes", "--output", rig.path("absent/m.json")), "absent/m.json"),
                              (("--yes", "--output", folder), "directory")):
        code, _, err = takes.ask(rig, "calibrate", "--output", rig.path("m.json"), *options)
        assert code == 2 and sentence in err, (options, code, err)
    assert not rig.takes()


if __name__ == "__main__":
    harness.main(globals())
