#!/usr/bin/python3 -B
"""What the dome may do to people and to itself: heat, power, the emergency stop, what is left lit
after a take and after a crash. The controller is the simulator, spoken to over its protocol."""
import harness
import takes

WORK = 'work_light = { channel = "R"; level = 2000; };'


def now(rig):
    """What the controller says of this moment."""
    return takes.lights_status(rig)["now"]


def refused(rig, plan, *words):
    code, _, err = takes.ask(rig, "preflight", "--plan", takes.plan_file(rig, plan))
    assert code == 6, (code, err)
    takes.says(err, *words)
    assert takes.exposures(rig) == 0, "something was fired"


def test_a_take_ends_in_the_work_light_and_blank_puts_it_out(folder):
    rig = harness.twelve(folder, daemon_extra=WORK).start()
    assert now(rig) == []
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0 and status["state"] == "complete", err
    takes.is_good(rig, status["id"], pixels=False)
    assert now(rig) == ["work light"]
    assert takes.ask(rig, "blank")[0] == 0
    assert now(rig) == []


def test_after_a_crash_the_controller_shows_the_work_light_by_itself(folder):
    rig = harness.twelve(folder, daemon_extra=WORK, scene="stamp").start()
    take = takes.begin(rig, takes.LONG)
    takes.fire(rig, takes.FIRST_LIGHT + 20)
    assert not harness.work_light(rig)
    rig.daemon.kill()
    rig.daemon = None
    harness.wait_for("the controller shows the work light", lambda: harness.work_light(rig))
    rig.start_daemon()
    lights = takes.lights_status(rig)
    assert lights["faults"] == ["heartbeat"] and lights["now"] == ["work light"], lights
    code, status, err = takes.resume_freed(rig, take)
    assert code == 0, (status, err)
    takes.is_good(rig, take)
    assert now(rig) == ["work light"]


def test_a_hot_dome_pauses_the_take_and_an_overheated_one_ends_it(folder):
    rig = harness.twelve(folder, '{ kind = "heat"; at = 30; value = 300; }, '
                                 '{ kind = "overheat"; at = 45; }',
                         scene="stamp", daemon_extra=WORK).start()
    events, told = takes.Events(rig, "--alarms"), []
    code, status, err = takes.photograph(rig)
    assert code == 1 and status["state"] == "failed", (code, status, err)
    while ("fault", True) not in told:
        event = events.next("alarm")
        told.append((event["kind"], event["active"]))
    events.stop()
    assert told == [("hot", True), ("hot", False), ("fault", True)], told
    takes.says(status["message"], "over-temperature", "step 45", "resume the take")
    lights = takes.lights_status(rig)
    assert "work light" not in lights["now"], lights
    takes.says(" ".join(takes.alarms(rig, status["id"])), "until the dome had cooled: it was at 70 C",
               "no work light")
    fired = takes.exposures(rig)
    code, _, err = takes.resume(rig, status["id"])
    assert code == 6, (code, err)
    takes.says(err, "the dome is at 85 C, 15 over the 70 C", "let it cool")
    assert takes.exposures(rig) == fired


def test_a_pressed_emergency_stop_is_named_before_anything_else(folder):
    rig = harness.twelve(folder, '{ kind = "estop"; at = 10; }').start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], "emergency stop")
    lights = takes.lights_status(rig)
    assert lights["faults"] == ["e-stop"] and lights["now"] == ["e-stop pressed"], lights
    fired = takes.exposures(rig)
    code, _, err = takes.resume(rig, status["id"])
    assert code == 6, (code, err)
    takes.says(err, "emergency stop is pressed: release it")
    assert takes.exposures(rig) == fired


LIVE = 'subject = "live"; exposures_us = [5000]; darks = 4; ' \
       'conditions = ( { kind = "each"; channels = ["W", "R", "G", "B"]; } );\n'


def test_a_live_subject_is_spared_the_flashes_of_a_controller_that_stalls(folder):
    # 72 Hz as planned; 60 ms late at every fifth step, 8 times a second: the fourth flash is step 20
    stalls = ", ".join(f'{{ kind = "stall"; at = {at}; value = 60; }}' for at in range(10, 30, 5))
    rig = harness.twelve(folder, stalls).start()
    code, status, err = takes.photograph(rig, LIVE)
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], r"the live subject saw pulses at \d", "LEDs are dark", "resume")
    lit = [e for e in harness.shown(rig) if e["kind"] != "dark"]
    assert max(e["step"] for e in lit) < 40, "it was shown more than was granted at the fourth flash"
    code, status, err = takes.resume(rig, status["id"])  # one stall is left
    assert code == 0 and status["state"] == "complete", (status, err)
    takes.is_good(rig, status["id"], pixels=False)


def test_power_and_work_light_over_a_limit_are_refused_with_how_much(folder):
    # twelve lights of 2.5 W at full level, 12.5 ms of every 13.9: 27 W
    rig = harness.twelve(folder, controller_extra="max_power_mw = 10000; max_duty_permille = 1000;",
                         daemon_extra='work_light = { channel = "W"; level = 32768; };').start()
    refused(rig, harness.PLAN, "work light: the dome would draw 15.00 W", "5.00 W over", "10.00 W")
    rig.daemon_extra = ""
    assert rig.daemon.stop() is None
    rig.start_daemon()
    # every one of these shows all lights: 27 pulses of 12.5 ms within a second are 10.1 J
    plan = ('subject = "still"; exposures_us = [12500]; darks = 4;\n'
            'conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B", "V", "H"]; '
            'level = 65535; }, { kind = "segments"; count = 1; channels = ["W", "R", "A", "G", "C", '
            '"B", "V", "H"]; level = 65535; }, { kind = "segment"; lights = [0, 1, 2, 3, 4, 5, 6, 7, '
            '8, 9, 10, 11]; channels = ["W", "R", "A", "G", "C", "B", "V", "H"]; level = 65535; }, '
            '{ kind = "headlight"; lights = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]; channels = ["W", '
            '"R", "A", "G", "C", "B", "V", "H"]; level = 65535; } );\n')
    refused(rig, plan, "the dome would draw 10.12 W, mean over a second, 0.12 W over the "
                       "controller's 10.00 W")


if __name__ == "__main__":
    harness.main(globals())
