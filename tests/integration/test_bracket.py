#!/usr/bin/python3 -B
"""Exposures that are no pulse widths: a camera whose exposure is a register is shot exposure by
exposure. Stamps are read from raw."""
import os
import struct

import harness
import takes

import pictures

SETTLING = 5  # pulses: before every round of darks and lights but the first, for three exposures
PLAN = """subject = "still";
exposures_us = [500, 2500, 12500];
darks = 4;
reference = { every = 0; };
conditions = ( { kind = "sphere"; channels = ["W", "R"]; },
               { kind = "each"; channels = ["W"]; } );
"""
DARKS, LIGHTS = 12, 14  # frames of darks; conditions with lights


def timed(folder, **options):
    """A camera that offers no exposure by width: nobody says so but itself."""
    return harness.twelve(folder, scene="stamp", camera_extra="timed_only = true;",
                          **options).start()


def order(rig, take):
    """(dark, exposure) of the stored shots, as they were fired."""
    plan = takes.document(rig, take)["plan"]["conditions"]
    shots = sorted(takes.records(rig, take, "ticket"), key=lambda t: t["controller_us"])
    return [(plan[t["condition"]]["kind"] == "dark", t["exposure"]) for t in shots]


def used_is_what_was_set(rig, take):
    """The register, as read back, in tickets; of a condition the longest in its file."""
    longest = {}
    for ticket in takes.records(rig, take, "ticket"):
        used = ticket["exposure_used_us"]
        # the register holds whole us
        assert abs(used - (500, 2500, 12500)[ticket["exposure"]]) <= 1, ticket
        assert abs(used - ticket["chunk_exposure_us"]) <= 1, ticket
        longest[ticket["condition"]] = max(used, longest.get(ticket["condition"], 0))
    plan = takes.document(rig, take)["plan"]["conditions"]
    for record in takes.published(rig, take):
        of = next(i for i, c in enumerate(plan) if c["id"] == record["condition"])
        path = os.path.join(takes.folder(rig, take), record["file"])
        seconds, = struct.unpack("<f", pictures.attributes(path)["expTime"][1])
        assert abs(seconds * 1e6 - longest[of]) < 1e-6 * longest[of], (path, seconds)


def test_a_camera_with_a_register_is_shot_exposure_by_exposure(folder):
    # a shot of the first exposure is lost, and shot again at its exposure
    lost = takes.WARM_UP + DARKS + 3 + 2
    rig = timed(folder, faults=f'{{ kind = "lose_frame"; at = {lost}; }}')
    code, status, err = takes.photograph(rig, PLAN)
    assert code == 0 and status["state"] == "complete", (status, err)
    take = status["id"]
    fired = order(rig, take)
    assert fired == sorted(fired, key=lambda s: (not s[0], s[1])), fired
    assert len(fired) == DARKS + 3 * LIGHTS, len(fired)
    assert status["shots_repaired"] >= 1, status
    used_is_what_was_set(rig, take)
    said = rig.ask("preflight", "--plan", takes.plan_file(rig, PLAN))
    assert said["bracket"] == takes.document(rig, take)["plan"]["bracket"] == "outermost", said
    takes.is_good(rig, take)
    counted = rig.ask("metrics")["cameras"][0]
    assert counted["settling_pulses"] == SETTLING, counted


def test_an_aborted_take_goes_on_with_the_exposures_it_has(folder):
    rig = timed(folder)
    take = takes.begin(rig, PLAN)
    # in the second exposure of lights
    takes.fire(rig, takes.WARM_UP + DARKS + 4 + LIGHTS + 6)
    assert takes.ask(rig, "take", "abort")[0] == 0
    assert takes.ended(rig)[1]["state"] == "aborted"
    had = {t["shot"] for t in takes.records(rig, take, "ticket")}
    code, status, err = takes.resume(rig, take)
    assert code == 0 and status["state"] == "complete", (status, err)
    again = [t["shot"] for t in takes.records(rig, take, "ticket") if t["attempt"] > 0]
    # what had been fired and not bound when the take was aborted may count as tried
    assert len(had) >= DARKS + LIGHTS and not set(again) & had, (had, again)
    takes.is_good(rig, take)


def test_the_rig_file_has_the_last_word_on_how_a_camera_exposes(folder):
    rig = harness.twelve(folder, scene="stamp", rig_camera_extra='exposure = "timed";').start()
    plan = takes.plan_file(rig, PLAN)
    assert rig.ask("preflight", "--plan", plan)["bracket"] == "outermost"
    conf = harness.stage.read(rig.path("rig.conf"))
    for said, bracket in (('exposure = "width";', "width"), ("", "width")):
        rig.daemon.stop()
        harness.stage.write(rig.path("rig.conf"), conf.replace('exposure = "timed";', said))
        rig.write_configuration = lambda: None
        rig.start_daemon()
        assert rig.ask("preflight", "--plan", plan)["bracket"] == bracket, said


def test_a_width_that_the_camera_does_not_offer_is_refused(folder):
    rig = timed(folder, rig_camera_extra='exposure = "width";')
    code, _, err = takes.ask(rig, "preflight", "--plan", takes.plan_file(rig, PLAN))
    assert code != 0, err
    takes.says(err, "offers no TriggerWidth", "use timed exposure")


if __name__ == "__main__":
    harness.main(globals())
