#!/usr/bin/python3 -B
"""Clients that interrupt, die, repeat themselves or come at the same time, and daemons that meet."""
import json
import os
import signal

import harness
import takes
from harness import stage


def middle(rig):
    takes.fire(rig, takes.FIRST_LIGHT + 20)


def test_ctrl_c_aborts_the_take_and_waits_until_it_is_dark(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    client = takes.begin(rig, takes.LONG, wait=True)
    middle(rig)
    takes.interrupt(client)
    out, err = client.communicate(timeout=30)
    fired = takes.exposures(rig)
    assert client.returncode == 130, (client.returncode, err)
    takes.says(err, "aborting; waiting for the lights to be dark")
    status = json.loads(out)
    assert status["state"] == "aborted", status
    takes.says(status["message"], "LEDs are dark", "stored")
    lights = takes.lights_status(rig)
    assert lights["state"] == "loaded" and not lights["faults"], lights
    assert takes.exposures(rig) == fired, "it fired after the client had gone"
    code, again, err = takes.resume(rig, status["id"])
    assert code == 0, (again, err)
    takes.is_good(rig, status["id"])


def test_a_second_ctrl_c_leaves_at_once_and_the_daemon_finishes_aborting(folder):
    # the daemon is held for a moment so that the client must wait; the dome would blank by itself
    rig = harness.twelve(folder, controller_extra="heartbeat_ms = 20000;").start()
    client = takes.begin(rig, takes.LONG, wait=True)
    middle(rig)
    rig.daemon.child.send_signal(signal.SIGSTOP)
    try:
        takes.interrupt(client)
        words = ""
        while "aborting" not in words:
            line = client.stderr.readline()
            assert line, f"the client left: {words}"
            words += line
        takes.interrupt(client)
        _, err = client.communicate(timeout=10)
    finally:
        rig.daemon.child.send_signal(signal.SIGCONT)
    assert client.returncode == 130, (client.returncode, err)
    takes.says(err, "leaving; the daemon finishes aborting")
    code, status = takes.ended(rig)
    assert code == 1 and status["state"] == "aborted", status


def test_a_client_that_is_killed_leaves_the_take_running(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    client = takes.begin(rig, takes.KEEP_RAW, wait=True)
    middle(rig)
    client.kill()
    client.communicate()
    code, status = takes.ended(rig)
    assert code == 0 and status["state"] == "complete", status
    takes.is_good(rig, status["id"])
    assert len(rig.takes()) == 1


def test_a_client_says_when_the_daemon_is_gone(folder):
    rig = harness.twelve(folder).start()
    client = takes.begin(rig, takes.LONG, wait=True)
    middle(rig)
    rig.daemon.kill()
    rig.daemon = None
    _, err = client.communicate(timeout=10)
    assert client.returncode == 3, (client.returncode, err)
    takes.says(err, "connection", "--token begun")
    code, _, err = takes.ask(rig, "status")
    assert code == 3, (code, err)
    takes.says(err, "no lightstaged answers at")


def test_of_two_clients_that_start_at_once_one_is_told_that_the_other_was_first(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    clients = [takes.begin(rig, takes.KEEP_RAW, name=f"take{k}", token=f"token{k}", wait=True)
               for k in range(2)]
    ends = [(c.communicate(timeout=60), c.returncode) for c in clients]
    assert sorted(code for _, code in ends) == [0, 5], ends
    takes.says(next(err for (_, err), code in ends if code), "is running", "201 busy")
    kept, = rig.takes()
    takes.is_good(rig, kept["id"])


def test_devices_that_a_take_has_and_nobody_asked_before_are_said_to_be_in_use(folder):
    rig = harness.twelve(folder).start()
    takes.begin(rig, takes.LONG)
    said = takes.ask(rig, "status")[1]
    takes.says(said, "lights       in use", "front: in use")
    assert takes.ask(rig, "take", "abort")[0] == 0
    takes.ended(rig)
    said = takes.ask(rig, "status")[1]
    takes.says(said, "LS-DOME-SIM-0001", "lightstage-sim, serial SIM0")


def test_a_retry_with_the_same_token_starts_one_take(folder):
    rig = harness.twelve(folder).start()
    clients = [takes.begin(rig, harness.PLAN, wait=True) for _ in range(3)]
    ends = [json.loads(c.communicate(timeout=60)[0]) for c in clients]
    assert len({e["id"] for e in ends}) == 1 == len(rig.takes()), ends
    assert {e["state"] for e in ends} == {"complete"}, ends
    code, out, _ = takes.ask(rig, "take", "start", "--token", "begun", "--no-wait", "--plan",
                             takes.plan_file(rig, harness.PLAN), "--json")
    assert code == 0 and json.loads(out)["already"], out
    # one take's exposures; a busy machine may have repaired a few, never half a take
    assert len(harness.shown(rig)) < takes.LAST + takes.LIGHTS // 2, "something was shot twice"


def second(rig, **changes):
    """The command of another daemon for the same rig."""
    text = stage.read(rig.path("daemon.conf"))
    for old, new in changes.items():
        text = text.replace(f'{old} = "{old if old == "socket" else "takes"}"', f'{old} = "{new}"')
    stage.write(rig.path("second.conf"), text)
    return (rig.path("second.log"), rig.program("daemon/lightstaged"), "--config",
            rig.path("second.conf"))


def test_a_socket_in_use_by_a_living_daemon_is_left_to_it(folder):
    rig = harness.twelve(folder).start()
    harness.refuses("is in use by a running lightstaged; stop it or set another socket path",
                    lambda: stage.Process(*second(rig)), code=1)
    assert rig.ask("status")["lights"]["connected"]


def test_the_socket_of_a_dead_daemon_is_replaced_and_a_file_is_not(folder):
    rig = harness.twelve(folder).start()
    rig.daemon.kill()
    assert os.path.exists(rig.path("socket"))
    rig.start_daemon()
    assert rig.ask("status")["lights"]["connected"]
    assert rig.daemon.stop() is None and not os.path.exists(rig.path("socket"))
    stage.write(rig.path("socket"), "precious")
    harness.refuses("is no socket; move it away", rig.start_daemon, code=1)
    assert stage.read(rig.path("socket")) == "precious"
    rig.daemon = None


def test_a_second_daemon_on_the_same_rig_does_not_disturb_a_take(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    other = stage.Process(*second(rig, socket="other", storage="others"))
    try:
        take = takes.begin(rig, takes.LONG)
        middle(rig)
        ask = [rig.program("clients/lightstagectl"), "--socket", rig.path("other")]
        lights = json.loads(stage.call(*ask, "status", "--json"))["lights"]
        assert lights["connected"] and lights["state"] == "armed", lights
        harness.refuses("another program controls it", lambda: stage.call(
            *ask, "take", "start", "--plan", rig.path("plan.conf")), code=5)
        code, status = takes.ended(rig)
        assert code == 0 and status["id"] == take, status
        takes.is_good(rig, take)
        # but dark is dark, whoever asks for it
        take = takes.begin(rig, takes.LONG, token="again")
        takes.fire(rig, takes.exposures(rig) + 60)
        stage.call(*ask, "blank")
        code, status = takes.ended(rig, token="again")
        assert code == 1 and status["state"] == "failed", status
        takes.says(status["message"], "blanked by somebody else", "resume the take")
    finally:
        complaint = other.stop()
    assert not complaint, complaint
    code, status, err = takes.resume(rig, take)
    assert code == 0, (status, err)
    takes.is_good(rig, take)


if __name__ == "__main__":
    harness.main(globals())
