#!/usr/bin/python3 -B
"""Exposures by pulse width on a sensor that adds what nobody wrote down: it is measured with the
dome's light, stands in ticket and take, and is what the merge divides by."""
import json
import os
import re

import harness
import takes
from harness import stage

import pictures

OFFSET_US = 41.3  # not the simulator's own 13.7


def unsaid(folder, said="", **options):
    """A rig whose file says nothing of the offset, or something else than is true."""
    options.setdefault("camera_extra", f"exposure_offset_us = {OFFSET_US};")
    rig = harness.twelve(folder, **options)
    rig.start_simulator()
    rig.write_configuration()
    text = stage.read(rig.path("rig.conf"))
    changed, n = re.subn(r"exposure_offset_us = [^;]*;", said, text)
    assert n == 1, text
    stage.write(rig.path("rig.conf"), changed)
    rig.write_configuration = lambda: None
    rig.start_daemon()
    return rig


def plan(exposures, conditions='{ kind = "sphere"; channels = ["W"]; level = 65535; }', extra=""):
    return (f'subject = "still"; exposures_us = {exposures}; darks = 32;\n'
            f'conditions = ( {conditions} );\n{extra}\n')


def camera_of(rig, take):
    return takes.document(rig, take)["rig"]["cameras"][0]


def radiance(rig, take, condition="sphere-W"):
    """E per pixel, full scale per second."""
    file, = (r["file"] for r in takes.published(rig, take) if r["condition"] == condition)
    stored = pictures.read(os.path.join(takes.folder(rig, take), file))
    return stored / takes.document(rig, take)["reference_exposure_s"]


def test_the_offset_is_measured_and_every_width_gives_the_same_radiance(folder):
    rig = unsaid(folder, size=256)
    seen = {}
    for exposures in ("[200]", "[400, 1600, 6400]"):
        code, status, err = takes.photograph(rig, plan(exposures))
        assert code == 0 and status["state"] == "complete", (status, err)
        take, camera = status["id"], camera_of(rig, status["id"])
        offset, sigma = camera["exposure_offset_us"], camera["exposure_offset_sigma_us"]
        print(f"# {exposures}: offset {offset:.3f} +- {sigma:.3f} us")
        assert 0 < sigma <= 0.5, sigma
        # five sigma of it, and 0.02 us of the clocks' 35 ppm on pulses of up to 500 us
        assert abs(offset - OFFSET_US) < 5 * sigma + 0.02, (offset, sigma)
        for ticket in takes.records(rig, take, "ticket"):
            assert abs(ticket["exposure_used_us"] - ticket["width_us"] - offset) < 1e-6, ticket
        used_s = [(width + offset) * 1e-6 for width in json.loads(exposures)]
        document = takes.document(rig, take)
        assert all(abs(said - used) < 1e-12 for said, used
                   in zip(document["exposure_s"], used_s, strict=True)), document["exposure_s"]
        seen[exposures] = radiance(rig, take)
    base = seen["[400, 1600, 6400]"]
    for exposures, e in seen.items():
        # 2 % of full scale or more at 200 us, and not clipped at 1600
        fair = (base * 1641e-6 < 0.8) & (base * 241e-6 > 0.02)
        assert fair.sum() > 2000, fair.sum()
        ratio = e[fair].sum() / base[fair].sum()
        print(f"# {exposures}: {ratio:.5f} over {fair.sum()} pixels")
        # without the offset 200 us would read 1.2; an error of 0.2 us makes 0.1 %, the shot noise of
        # 2000 pixels of 500 electrons the same, and three times both together 0.4 %
        assert abs(ratio - 1) < 0.004, (exposures, ratio)


def test_a_resumed_take_keeps_the_offset_it_began_with(folder):
    rig = unsaid(folder)
    take = takes.begin(rig, takes.LONG)
    harness.wait_for("some of it is stored", lambda: len(takes.published(rig, take)) > 6)
    assert takes.ask(rig, "take", "abort")[0] == 0
    assert takes.ended(rig)[1]["state"] == "aborted"
    before, exposures_s = camera_of(rig, take), takes.document(rig, take)["exposure_s"]
    code, status, err = takes.resume(rig, take)
    assert code == 0 and status["state"] == "complete", (status, err)
    assert camera_of(rig, take) == before
    assert takes.document(rig, take)["exposure_s"] == exposures_s
    added = {round(t["exposure_used_us"] - t["width_us"], 6)
             for t in takes.records(rig, take, "ticket")}
    assert added == {round(before["exposure_offset_us"], 6)}, added
    takes.is_good(rig, take, pixels=False)


def test_where_it_cannot_be_measured_the_take_is_refused_with_a_sentence(folder):
    # a live subject would see it; a camera that sees nothing cannot tell
    rig = unsaid(folder, camera_extra="white_exposure_us = 1e7;")
    live = plan("[500]").replace("still", "live")
    code, _, err = takes.ask(rig, "take", "start", "--plan", takes.plan_file(rig, live))
    assert code == 6, (code, err)
    takes.says(err, "exposure_offset_us", "would flash at a live subject", "take.json")
    assert os.listdir(rig.path("takes")) == [], os.listdir(rig.path("takes"))
    code, status, err = takes.photograph(rig, plan("[500, 2500]"))
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], "cannot be measured", "set exposure_offset_us", "something brighter")
    assert takes.published(rig, status["id"]) == []


def test_a_bracket_that_the_measured_offset_tears_apart_is_refused(folder):
    # 8 of the 8.5 that the camera's range bears, but 11 once each is 30 us shorter
    rig = unsaid(folder, camera_extra="exposure_offset_us = -30.0;")
    code, status, err = takes.photograph(rig, plan("[100, 800]"))
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], "step after 100 us leaves a gap", "its offset of -(30|29)")
    assert takes.records(rig, status["id"], "ticket") == []


def test_blank_ends_the_measuring_too(folder):
    rig = unsaid(folder)
    take = takes.begin(rig, takes.LONG)
    takes.fire(rig, 20)  # of the hundred pulses and more that it takes
    assert takes.ask(rig, "blank")[0] == 0
    code, status = takes.ended(rig)
    assert code == 1 and status["state"] == "aborted", status
    fired = takes.exposures(rig)
    assert fired < 90, fired
    assert takes.published(rig, take) == []


def test_an_offset_that_eats_a_pulse_is_refused(folder):
    rig = unsaid(folder, said="exposure_offset_us = -300.0;")
    code, _, err = takes.ask(rig, "preflight", "--plan", takes.plan_file(rig, plan("[300, 900]")))
    assert code == 4, (code, err)
    takes.says(err, "300 us and the offset of camera 0 \\(-300 us\\) leave no exposure")


if __name__ == "__main__":
    harness.main(globals())
