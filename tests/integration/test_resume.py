#!/usr/bin/python3 -B
"""The daemon killed, ended and started again in the middle of a take: what is published stays, what
is missing is shot, and nothing else."""
import collections
import json
import os
import random
import time

import harness
import takes

HEARTBEAT_S = 1.0  # the simulated controller's
LATE_S = 0.25      # a pulse's length, and what a loaded machine may add to the heartbeat's timer
PULSES_US = (500, 2500, 12500)
LONG_LIGHTS = 12 * 4 * len(PULSES_US)


def now_s():
    return time.clock_gettime(time.CLOCK_MONOTONIC_RAW)


def dice():
    seed = int(os.environ.get("LS_TEST_SEED") or time.time_ns() % 1000000)
    print(f"# LS_TEST_SEED={seed}")
    return random.Random(seed)


def go_dark(rig, killed_s):
    """Wait until the controller must have noticed that its host is gone; nothing fires later."""
    harness.wait_for("the heartbeat's time is over",
                     lambda: now_s() > killed_s + HEARTBEAT_S + LATE_S)
    fired = harness.shown(rig)
    late = max(e["true_ns"] for e in fired) * 1e-9 - killed_s
    assert late < HEARTBEAT_S + LATE_S, f"an exposure {late:.3f} s after the host had died"
    return fired


def kind_of(exposure):
    """What an exposure of the simulator's log shows: light, channel, index in the bracket."""
    nearest = min(range(len(PULSES_US)), key=lambda k: abs(exposure["lit_us"] - PULSES_US[k]))
    return exposure["kind"], exposure["light"], exposure["channel"], nearest


def wanted(condition):
    """The exposures a condition of take.json asks for, as kind_of names them."""
    if condition["kind"] == "dark":
        return [("dark", -1, -1, condition["exposure"])] * condition["steps"]
    light = int(condition["id"].split("-")[1])
    return [("one", light, "WRAGCBVH".index(condition["channel"]), k) for k in range(3)]


def shoots_only_what_is_missing(rig, take, before):
    """After resume, of what was in the log already: every exposure was one that was missing."""
    done = {r["condition"] for r in before}
    asked = collections.Counter()
    for condition in takes.document(rig, take)["plan"]["conditions"]:
        if condition["id"] not in done:
            asked.update(wanted(condition))
    return asked


def killed_and_resumed(folder, moment):
    """kill -9 when so many exposures were made, restart, resume, compare."""
    rig = harness.twelve(folder, scene="stamp").start()
    take = takes.begin(rig, takes.LONG)
    takes.fire(rig, moment)
    rig.daemon.kill()
    killed_s = now_s()
    rig.daemon = None
    fired = go_dark(rig, killed_s)
    files, published = takes.files(rig, take), takes.published(rig, take)
    print(f"# killed after {moment} exposures, {len(published)} pictures were published")
    rig.start_daemon()
    lights = takes.lights_status(rig)
    # a program that was just through, or not yet armed, needed no heartbeat to be dark
    if 0 < fired[-1]["step"] < takes.DARKS - 1 or takes.DARKS - 1 < fired[-1]["step"]:
        assert lights["state"] == "fault" and "heartbeat" in lights["faults"], (lights, fired[-1])
    asked = shoots_only_what_is_missing(rig, take, published)
    code, status, err = takes.resume_freed(rig, take)
    assert code == 0 and status["state"] == "complete", (status, err)
    shot = collections.Counter(map(kind_of, harness.shown(rig)[len(fired):]))
    warm_up = shot[("dark", -1, -1, 0)] - asked[("dark", -1, -1, 0)]
    shot[("dark", -1, -1, 0)] -= warm_up
    assert 5 <= warm_up <= 24, warm_up  # pulses that fit the clocks: daemon/warm_up.c
    repaired = [a for a in takes.alarms(rig, take) if a.startswith("repair pass")]
    if not repaired:  # a machine so busy that frames were lost may shoot a condition twice
        assert shot == asked, (shot - asked, asked - shot)
    assert set(+shot) == set(+asked), (shot, asked)
    takes.is_good(rig, take)
    after = takes.files(rig, take)
    assert all(after[name] == data for name, data in files.items()), "a published file has changed"


def test_a_daemon_killed_at_random_moments_loses_nothing_that_was_published(folder):
    random_moment = dice()
    total = takes.WARM_UP + takes.DARKS + LONG_LIGHTS
    # among the darks; early; late, but for the steps that are granted ahead and fire all the same
    for first, last in ((takes.FIRST_DARK + 1, takes.FIRST_LIGHT - 1),
                        (takes.FIRST_LIGHT, total // 2), (total // 2, total - 45)):
        there = os.path.join(folder, str(first))
        os.mkdir(there)
        killed_and_resumed(there, random_moment.randint(first, last))
        assert not [c for rig in harness.STANDING for c in rig.stop()]
        harness.STANDING.clear()


def test_sigterm_leaves_the_lights_dark_and_the_take_resumable(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    client = takes.begin(rig, takes.LONG, wait=True)
    takes.fire(rig, takes.FIRST_LIGHT + 40)
    began = now_s()
    rig.daemon.child.terminate()
    # 5 s: what is bound is merged, written and synced; frames that come no more are waited for
    # half a second; the rest is what a busy machine adds
    assert rig.daemon.child.wait(5) == 0, "the daemon did not end well"
    ended_s = now_s()
    print(f"# ended {ended_s - began:.2f} s after SIGTERM")
    rig.daemon = None
    out, err = client.communicate(timeout=10)
    assert client.returncode == 1, (client.returncode, out, err)
    status = json.loads(out)
    assert status["state"] == "aborted", status
    takes.says(status["message"], "LEDs are dark")
    take = status["id"]
    assert max(e["true_ns"] for e in harness.shown(rig)) * 1e-9 <= ended_s
    fired = takes.exposures(rig)
    rig.start_daemon()
    lights = takes.lights_status(rig)
    assert lights["state"] == "loaded" and not lights["faults"], lights
    assert takes.exposures(rig) == fired
    assert [t["state"] for t in rig.takes()] == ["aborted"]
    code, status, err = takes.photograph(rig, takes.LONG, token="begun")  # as a client in doubt does
    assert code == 1 and status["id"] == take and status["state"] == "aborted", (status, err)
    assert takes.exposures(rig) == fired and len(rig.takes()) == 1
    files, published = takes.files(rig, take), takes.published(rig, take)
    asked = shoots_only_what_is_missing(rig, take, published)
    assert published and asked
    code, status, err = takes.resume(rig, take)
    assert code == 0, (status, err)
    takes.is_good(rig, take)
    after = takes.files(rig, take)
    assert all(after[name] == data for name, data in files.items()), "a published file has changed"


def test_a_take_is_not_resumed_on_a_damaged_dark(folder):
    rig = harness.twelve(folder).start()
    take = takes.begin(rig, takes.LONG)
    takes.fire(rig, takes.FIRST_LIGHT + 20)
    assert takes.ask(rig, "take", "abort")[0] == 0
    assert takes.ended(rig)[1]["state"] == "aborted"
    name = next(p["file"] for p in takes.published(rig, take) if p["condition"].startswith("dark"))
    path = os.path.join(takes.folder(rig, take), name)
    with open(path, "rb") as file:
        sound = file.read()
    with open(path, "wb") as file:
        file.write(sound[:-100] + bytes([sound[-100] ^ 1]) + sound[-99:])
    fired = takes.exposures(rig)
    code, _, err = takes.resume(rig, take)
    print("#", err.strip())
    assert code != 0 and takes.exposures(rig) == fired, (code, err)
    takes.says(err, os.path.basename(name), "make the take anew", "(402 damaged)")
    with open(path, "wb") as file:
        file.write(sound)
    code, status, err = takes.resume(rig, take)
    assert code == 0 and status["state"] == "complete", (status, err)


def test_a_complete_take_is_not_resumed(folder):
    rig = harness.twelve(folder).start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    fired = takes.exposures(rig)
    code, _, err = takes.resume(rig, status["id"])
    assert code == 5, (code, err)
    takes.says(err, "is complete: nothing to resume")
    code, _, err = takes.resume(rig, "20200101T000000Z-nothing-abcdef")
    assert code == 5, (code, err)
    takes.says(err, "not found")
    code, _, err = takes.resume(rig, "../../etc")
    assert code == 5, (code, err)
    assert takes.exposures(rig) == fired


def test_a_take_is_not_resumed_on_a_rig_that_has_changed(folder):
    rig = harness.twelve(folder).start()
    take = takes.begin(rig, takes.LONG)
    takes.fire(rig, takes.FIRST_LIGHT + 10)
    assert takes.ask(rig, "take", "abort")[0] == 0
    assert takes.ended(rig)[1]["state"] == "aborted"
    assert rig.daemon.stop() is None
    path = rig.path("positions.csv")
    rows = harness.stage.read(path).splitlines()
    harness.stage.write(path, "\n".join(rows[:-2] + [rows[-1], rows[-2]]) + "\n")
    rig.start_daemon()
    fired = takes.exposures(rig)
    code, _, err = takes.resume(rig, take)
    assert code == 5, (code, err)
    takes.says(err, "206 rig changed", "light")
    assert takes.exposures(rig) == fired, "something was fired"


if __name__ == "__main__":
    harness.main(globals())
