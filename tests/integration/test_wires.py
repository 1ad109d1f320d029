#!/usr/bin/python3 -B
"""Takes over the controller's other wires: a serial line, and USB with what USB alone can suffer.
Modbus TCP is every other test's."""
import harness
import takes


def take_over(folder, wire, faults="", **options):
    rig = harness.twelve(folder, faults, scene="stamp", wire=wire, **options).start()
    code, status, err = takes.photograph(rig)
    assert code == 0 and status["state"] == "complete", (err, status)
    judged = takes.is_good(rig, status["id"])
    return rig, status, judged


def test_a_take_over_a_serial_line_is_complete(folder):
    take_over(folder, "modbus-rtu")


def test_a_take_over_usb_is_complete(folder):
    take_over(folder, "usb")


def test_lost_and_damaged_event_packets_cost_no_shot(folder):
    _, _, judged = take_over(folder, "usb",
                             '{ kind = "lose_packet"; at = 10; count = 4; }, '
                             '{ kind = "damage_packet"; at = 20; count = 4; }, '
                             '{ kind = "halt"; at = 30; }')
    assert judged["shots_repaired"] == 0, judged


def test_a_plug_pulled_for_a_moment_is_waited_for(folder):
    # 300 ms: less than the timeout, and than the second after which the controller goes dark
    take_over(folder, "usb", '{ kind = "disconnect"; at = 30; value = 300; }')


def test_a_pulled_plug_leaves_the_lights_dark_and_a_resumable_take(folder):
    rig = harness.twelve(folder, '{ kind = "disconnect"; at = 30; value = 4000; }', scene="stamp",
                         wire="usb", timeout_ms=500).start()
    code, status, err = takes.photograph(rig)
    assert code == 1 and status["state"] == "failed", (code, status, err)
    takes.says(status["message"], "USB controller")
    fired = takes.exposures(rig)
    harness.wait_for("the controller is plugged in again",
                     lambda: takes.lights_status(rig)["connected"])
    assert takes.exposures(rig) == fired, "it went on firing"
    code, status, err = takes.resume(rig, status["id"])
    assert code == 0, (status, err)
    takes.is_good(rig, status["id"])


if __name__ == "__main__":
    harness.main(globals())
