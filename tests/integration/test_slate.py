#!/usr/bin/python3 -B
"""The slate: written while the take runs and after it, without touching the take's data."""
import hashlib
import json
import os
import subprocess

import harness
import takes
from harness import stage


def sums(folder):
    """{relative path: checksum} of every file of a take but its slate."""
    out = {}
    for root, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(root, name)
            if name != "slate.json":
                with open(path, "rb") as file:
                    out[os.path.relpath(path, folder)] = hashlib.sha256(file.read()).hexdigest()
    return out


def slate(rig, take, *options):
    return json.loads(rig.control("take", "slate", take, *options, "--json"))


def test_a_slate_is_kept_beside_the_take_and_leaves_its_data_alone(folder):
    rig = harness.twelve(folder).start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    take = status["id"]
    before = sums(rig.path(f"takes/{take}"))
    nothing = {"slate": "", "scene": "", "take": 0, "circled": False, "timecode": "", "notes": ""}
    assert slate(rig, take) == nothing
    first = slate(rig, take, "--slate", "12A", "--take", "3", "--circled", "yes")
    assert first == {**nothing, "slate": "12A", "take": 3, "circled": True}, first
    second = slate(rig, take, "--notes", "blinked\nsmile", "--timecode", "10:11:12:13",
                   "--circled", "no")
    assert second == {**first, "notes": "blinked\nsmile", "timecode": "10:11:12:13",
                      "circled": False}, second
    takes.says(rig.control("take", "slate", take), "slate     12A", "take      3")
    assert sums(rig.path(f"takes/{take}")) == before
    rig.control("take", "verify", take)
    harness.refuses("HH:MM:SS:FF", lambda: slate(rig, take, "--timecode", "25:00:00:00"))
    harness.refuses("63 bytes", lambda: slate(rig, take, "--scene", "x" * 64))
    harness.refuses("not the name of a take", lambda: slate(rig, "../takes"))
    harness.refuses("No such file", lambda: slate(rig, "20260102T030405Z-none-a1b2c3"))
    assert slate(rig, take) == second


def test_two_who_write_at_once_lose_nothing_and_a_damaged_slate_is_set_aside(folder):
    rig = harness.twelve(folder).start()
    take = takes.photograph(rig, harness.PLAN)[1]["id"]
    clients = [subprocess.Popen(takes.ctl(rig, "take", "slate", take, *change),
                                stdout=subprocess.DEVNULL, preexec_fn=stage.die_with_parent)
               for _ in range(8) for change in (("--scene", "kitchen"), ("--take", "3"),
                                                ("--notes", "blinked"), ("--circled", "yes"))]
    assert all(client.wait(60) == 0 for client in clients)
    all_four = {"slate": "", "scene": "kitchen", "take": 3, "circled": True, "timecode": "",
                "notes": "blinked"}
    assert slate(rig, take) == all_four
    path = rig.path(f"takes/{take}/slate.json")
    stage.write(path, "{")
    harness.refuses("damaged", lambda: slate(rig, take))
    code, out, err = takes.ask(rig, "take", "slate", take, "--notes", "again", "--json")
    assert code == 0, err
    takes.says(err, "slate.damaged.json")
    assert json.loads(out) == {**all_four, "scene": "", "take": 0, "circled": False,
                               "notes": "again"}, out
    assert stage.read(rig.path(f"takes/{take}/slate.damaged.json")) == "{"
    rig.control("take", "verify", take)


def test_a_running_take_has_a_slate(folder):
    rig = harness.twelve(folder, '{ kind = "stall"; at = 10; value = 1500; }').start()
    take = takes.begin(rig, harness.PLAN)
    assert slate(rig, take, "--scene", "now")["scene"] == "now"
    harness.wait_for("the take is complete",
                     lambda: rig.ask("status")["take"]["state"] == "complete")
    assert slate(rig, take)["scene"] == "now"
    rig.control("take", "verify", take)


if __name__ == "__main__":
    harness.main(globals())
