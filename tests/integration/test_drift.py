#!/usr/bin/python3 -B
"""References: spheres between the lights that show whether the light drifts."""
import math

import harness
import takes

WARM_PULSES = 60
PLAN = """subject = "still"; exposures_us = [800, 6400]; darks = 16;
reference = { every = 12; level = 10922; };
conditions = ( { kind = "each"; channels = ["W", "R"]; } );
"""


def dome(drift):
    channel = ('{{ name = "{0}"; kind = "spectrum"; spectrum = "{1}"; droop = 1.0; '
               'drift = {2}; drift_pulses = {3}.0; }}')
    return ("lights = 12; channels = ( "
            + channel.format("W", "white", drift, WARM_PULSES) + ", "
            + channel.format("R", "red", 0.5, WARM_PULSES) + " );")


def rig_of(folder, drift):
    return harness.twelve(folder, size=96, channels="WR", scene_extra=dome(drift)).start()


def expected(rig, drift):
    """Relative change of every white sphere to the first, from when they were truly shown."""
    spheres = [n for n, e in enumerate(harness.shown(rig)) if e["kind"] == "sphere"]
    warm = [1 - drift * math.expm1(-n / WARM_PULSES) for n in spheres[1::2]]  # of the long exposure
    return [w / warm[0] - 1 for w in warm[1:]]


def said(rig, drift):
    """A take under a drift: (its alarms, its status, what its document says, what was true)."""
    code, status, err = takes.photograph(rig, PLAN)
    assert code == 0 and status["state"] == "complete", err
    found = takes.document(rig, status["id"])["drift"]
    true = expected(rig, drift)
    # 48 shots of lights: references before them, after every 12, and at the end
    assert [f["reference"] for f in found] == [f"reference-W-0{k}" for k in range(1, 5)], found
    assert len(true) == 4
    for f, t in zip(found, true):
        for change, error in zip(f["change"], f["error"]):
            # five standard errors, and a short exposure's share of the bracket, which is a pulse
            # older: an eighth of a sixtieth of the drift
            assert abs(change - t) < 5 * error + abs(drift) / 480, (f, t)
            assert error < 0.002, f
    print(f"# true {100 * true[-1]:+.2f} %, found {100 * found[-1]['change'][1]:+.2f} "
          f"+- {100 * found[-1]['error'][1]:.2f} %")
    return [a for a in takes.alarms(rig, status["id"]) if "drift" in a], status, found, true


def test_a_drift_of_one_and_a_half_percent_is_an_alarm(folder):
    rig = rig_of(folder, -0.047)
    alarms, status, found, true = said(rig, -0.047)
    assert -0.017 < true[-1] < -0.0145, true
    for f, t in zip(found, true):  # the worst colour decides, and an error is 0.1 %
        assert f["alarm"] == (t < -0.01) or abs(t + 0.01) < 0.003, (found, true)
    assert len(alarms) == sum(f["alarm"] for f in found), alarms
    told = takes.alarm(rig)
    assert (told["kind"], told["take"]) == ("drift", status["id"]), told
    takes.says(told["text"], "reference-W-0")
    takes.says(alarms[-1], "light drift: camera front: (red|green|blue) of reference-W-04 is -1",
               "allowed 1 %", "warm up")
    assert status["drift"]["alarm"] and status["drift"]["text"] == alarms[-1], status
    text = takes.ask(rig, "status")[1]
    takes.says(text, "reference-W-04", "take again")
    assert status["drift"] == rig.ask("status")["take"]["drift"]


def test_a_drift_of_three_quarters_of_a_percent_is_reported_and_no_alarm(folder):
    rig = rig_of(folder, -0.022)
    alarms, status, found, true = said(rig, -0.022)
    # less than is alarming, more than five standard errors
    assert -0.0085 < true[-1] < -0.006, true
    assert abs(found[-1]["change"][1]) > 5 * found[-1]["error"][1], found
    assert not alarms and not any(f["alarm"] for f in found), alarms
    assert not status["drift"]["alarm"] and status["drift"]["change"] < -0.005, status
    takes.says(status["drift"]["text"], "reference-W-0", "from the first reference$")


def test_a_resumed_take_compares_with_its_first_reference(folder):
    rig = harness.twelve(folder, size=96, channels="WR", scene_extra=dome(-0.04),
                         faults='{ kind = "interlock"; at = 40; value = 300.0; }').start()
    code, status, err = takes.photograph(rig, PLAN)
    assert code != 0 and status["state"] == "failed", err
    take, outcome = status["id"], []

    def is_complete():  # as soon as the interlock is closed again
        outcome[:] = takes.resume(rig, take)
        return outcome[0] == 0 and outcome[1]["state"] == "complete"
    harness.wait_for("the interlock is closed", is_complete)
    status = outcome[1]
    found = takes.document(rig, status["id"])["drift"]
    last = [f for f in found if f["reference"] == "reference-W-04"]
    assert len(last) == 1 and last[0]["alarm"], found
    assert status["drift"]["alarm"], status


def test_a_short_plan_has_no_references_and_a_plan_may_refuse_them(folder):
    rig = rig_of(folder, 0.0)
    for text in (PLAN.replace("reference = { every = 12; level = 10922; };", ""),
                 PLAN.replace("every = 12", "every = 0")):
        code, status, err = takes.photograph(rig, text)
        assert code == 0 and "drift" not in status, err
        document = takes.document(rig, status["id"])
        assert "drift" not in document
        assert not any(c.get("reference") for c in document["plan"]["conditions"])


if __name__ == "__main__":
    harness.main(globals())
