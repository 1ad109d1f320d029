#!/usr/bin/python3 -B
"""A take of twelve lights by the real daemon, from the command to the pixels."""
import json
import os
import time

import harness
import takes


def test_a_take_is_complete_and_every_frame_is_the_frame_it_says_it_is(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    code, status, err = takes.photograph(rig)
    assert code == 0 and status["state"] == "complete", err
    judged = takes.is_good(rig, status["id"])
    assert judged["shots_planned"] == judged["shots_stored"] == takes.DARKS + takes.LIGHTS, judged
    assert judged["shots_repaired"] == 0, judged
    assert not [a for a in takes.alarms(rig, status["id"]) if "repair" in a]
    assert status["message"] == "complete", status


def test_two_cameras_keep_every_frame_as_their_own(folder):
    rig = harness.twelve(folder, scene="stamp", cameras=2).start()
    code, status, err = takes.photograph(rig)
    assert code == 0 and status["state"] == "complete", err
    judged = takes.is_good(rig, status["id"])
    assert judged["shots_stored"] == 2 * (takes.DARKS + takes.LIGHTS), judged
    tickets = [t for t in takes.records(rig, status["id"], "ticket") if t["status"] == "ok"]
    for camera in (0, 1):
        shots = {t["shot"] for t in tickets if t["camera"] == camera}
        assert len(shots) == takes.DARKS + takes.LIGHTS, (camera, len(shots))
    assert set(os.listdir(takes.folder(rig, status["id"]))) >= {"cam0", "cam1"}


def test_four_cameras_on_one_link_keep_every_frame_as_their_own(folder):
    rig = harness.twelve(folder, scene="stamp", cameras=4, rig_extra="link_mbit_s = 1000;").start()
    code, status, err = takes.photograph(rig)
    assert code == 0 and status["state"] == "complete", (status, err)
    judged = takes.is_good(rig, status["id"])
    assert judged["shots_stored"] == 4 * (takes.DARKS + takes.LIGHTS), judged
    tickets = [t for t in takes.records(rig, status["id"], "ticket") if t["status"] == "ok"]
    assert [len({t["shot"] for t in tickets if t["camera"] == k}) for k in range(4)] == \
        4 * [takes.DARKS + takes.LIGHTS]
    planned = {c["id"] for c in takes.document(rig, status["id"])["plan"]["conditions"]}
    for view in range(4):  # four views of one plan: each has its own pictures of it
        names = {p["condition"] for p in takes.published(rig, status["id"]) if p["camera"] == view}
        assert names == planned, (view, names ^ planned)
        # is_good has read the stamp of each ticket's raw frame: there is none without a ticket
        raw = os.listdir(os.path.join(takes.folder(rig, status["id"]), f"cam{view}", "raw"))
        kept = {f"{t['shot']}-{t['attempt']}.raw" for t in tickets if t["camera"] == view}
        assert set(raw) == kept, (view, set(raw) ^ kept)


def test_four_cameras_that_do_not_fit_their_link_are_refused(folder):
    rig = harness.twelve(folder, cameras=4, size=256, rig_extra="link_mbit_s = 250;").start()
    code, _, err = takes.photograph(rig)
    assert code != 0
    takes.says(err, "0.53 MB of 4 cameras take 16\\d{3} us", "250 Mbit/s", "period_us = 16")


def test_one_camera_of_four_lost_is_named_and_the_others_pictures_are_safe(folder):
    lost = takes.FIRST_LIGHT + 20
    rig = harness.twelve(folder, f'{{ kind = "silent"; at = {lost}; camera = 2; }}', scene="stamp",
                         cameras=4, daemon_extra="retries = 1;").start()
    code, status, err = takes.photograph(rig)
    assert code == 1 and status["state"] in ("failed", "incomplete"), (code, status, err)
    takes.says(status["message"], "camera right|cam2/")
    stored = [p for p in takes.published(rig, status["id"])]
    for view in (0, 1, 3):  # six spheres are before it, and the shots up to the loss
        assert len([p for p in stored if p["camera"] == view]) >= 3 + 6, status
    wrong = takes.mislabeled_pixels(rig, status["id"])
    assert not wrong, wrong
    judged = rig.judge(status["id"])
    assert judged["frames_mislabeled"] == 0, judged


PERMUTED = """subject = "still"; exposures_us = [500, 2500]; darks = 2;
conditions = ( { kind = "each"; channels = ["W"]; order = "given"; },
               { kind = "segment"; channels = ["R"]; lights = [0, 1, 4]; } );
"""


def test_a_light_is_its_row_of_the_rig_file_whatever_its_address(folder):
    rig = harness.twelve(folder, scene="stamp", calibrated=False)
    with open(rig.path("positions.csv"), encoding="utf-8") as file:
        rows = [line.strip() for line in file if line[0] != "#"]
    order = [7, 3, 11, 0, 5, 1, 9, 2, 10, 4, 8, 6]
    with open(rig.path("positions.csv"), "w", encoding="utf-8") as file:
        file.writelines(f"{rows[address]},{address}\n" for address in order)
    rig.start()
    code, status, err = takes.photograph(rig, PERMUTED)
    assert code == 0, err
    judged = rig.judge(status["id"])
    assert judged["frames_mislabeled"] == 0, judged
    first = [e["light"] for e in harness.shown(rig) if e["kind"] == "one"][::2]
    assert first == order, first  # W-0000 is the light at row 0, which has address 7
    document = json.loads(harness.stage.read(os.path.join(takes.folder(rig, status["id"]),
                                                          "take.json")))
    segment = [c for c in document["plan"]["conditions"] if c["kind"] == "segment"][0]
    assert segment["lights"] == [0, 1, 4], segment


def test_a_take_is_watched_for_drift_and_states_its_darks_and_clocks(folder):
    # 54 conditions, so one watch; a camera's default black is 1/64 of full scale
    rig = harness.twelve(folder).start()
    plan = harness.PLAN.replace('channels = ["W"]; o', 'channels = ["W", "R", "G", "B"]; o')
    plan += "reference = { every = 0; };\n"
    code, status, err = takes.photograph(rig, plan)
    assert code == 0 and status["state"] == "complete", err
    judged = takes.is_good(rig, status["id"], pixels=False)
    assert judged["shots_stored"] == takes.DARKS + 54 * 3 + 4, judged
    home = takes.folder(rig, status["id"])
    document = json.loads(harness.stage.read(os.path.join(home, "take.json")))
    conditions = document["plan"]["conditions"]
    watches = [c for c in conditions if c.get("watch")]
    assert [c["id"] for c in watches] == ["watch-0"] and watches[0]["kind"] == "dark", watches
    assert conditions.index(watches[0]) == 3 + 50
    assert os.path.exists(os.path.join(home, "cam0", "watch-0.exr"))
    assert not [a for a in takes.alarms(rig, status["id"]) if "drift" in a]
    print("#", document["darks"], document["clocks"])
    darks = document["darks"]
    assert [(d["camera"], d["exposure"]) for d in darks] == [(0, 0), (0, 1), (0, 2)]
    for dark in darks:
        assert abs(dark["mean_dn"] - takes.FULL_SCALE_DN / 64) < 0.5, dark
        # 5 electrons of 10500 at full scale; a twentieth is far more than 8 x 16384 samples err
        assert abs(dark["read_noise_dn"] - 5 * takes.FULL_SCALE_DN / 10500) < 0.1, dark
        assert dark["clipped"] < 1e-3 and 0 <= dark["defects"] < 50, dark
    clocks = {c["clock"]: c for c in document["clocks"]}
    assert set(clocks) == {"controller", "cam0"}
    # the simulator's defaults, a clock that is slow makes the host's time pass faster. Reads of
    # 0.1 ms, and more on a busy machine, over 3 s: within 30 ppm
    for name, ppm in (("controller", 35), ("cam0", -20)):
        assert abs(clocks[name]["drift_ppm"] - ppm) < 30, clocks[name]
        assert clocks[name]["pairs"] >= 5, clocks[name]
    # where the two clocks stood is the same moment: the take was seconds ago, not hours
    now_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
    for clock in clocks.values():
        host_ns = clock["ticks"] * clock["tick_ns"] + clock["offset_ns"]
        assert 0 < now_ns - host_ns < 120e9, (clock, now_ns)


def test_a_ticket_corrupted_on_purpose_is_counted_as_exactly_one(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    path = os.path.join(takes.folder(rig, status["id"]), "journal")
    with open(path, "rb") as file:
        lines = file.read().split(b"\n")
    tickets = [k for k, line in enumerate(lines) if b'"k":"ticket"' in line]
    lit = [k for k in tickets if json.loads(lines[k][9:])["step"] >= takes.DARKS]
    # the exposure of a light that another light's frame is claimed to be
    mine, other = (json.loads(lines[k][9:]) for k in (lit[0], lit[-1]))
    mine["camera_ns"], mine["frame_id"] = other["camera_ns"], other["frame_id"]
    text = json.dumps(mine, separators=(",", ":")).encode()
    lines[lit[0]] = b"%08x %s" % (takes.crc32c(text), text)
    with open(path, "wb") as file:
        file.write(b"\n".join(lines))
    judged = rig.judge(status["id"])
    assert judged["frames_mislabeled"] == 1, judged
    assert judged["shots_stored"] == takes.DARKS + takes.LIGHTS, judged


def test_a_journal_line_damaged_before_the_end_is_named_by_verify(folder):
    rig = harness.twelve(folder).start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    path = os.path.join(takes.folder(rig, status["id"]), "journal")
    with open(path, "r+b") as file:
        file.seek(40)
        file.write(b"x")
    code, out, err = takes.ask(rig, "take", "verify", status["id"])
    assert code == 7, (code, out, err)
    takes.says(err, "line 1")


def test_a_picture_damaged_on_disk_is_found_by_verify(folder):
    rig = harness.twelve(folder).start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, err
    name = takes.published(rig, status["id"])[-1]["file"]
    path = os.path.join(takes.folder(rig, status["id"]), name)
    with open(path, "r+b") as file:
        file.seek(os.path.getsize(path) - 100)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 1]))
    code, out, err = takes.ask(rig, "take", "verify", status["id"])
    assert code == 1, (code, out, err)
    takes.says(out, "1 damaged", name)


def reticketed(path, lines, shot, **changed):
    """The journal with another ticket of a shot, as sound as the one that was there."""
    out = list(lines)
    for k, line in enumerate(lines):
        if b'"k":"ticket"' in line and json.loads(line[9:])["shot"] == shot:
            text = json.dumps({**json.loads(line[9:]), **changed}, separators=(",", ":")).encode()
            out[k] = b"%08x %s" % (takes.crc32c(text), text)
    with open(path, "wb") as file:
        file.write(b"\n".join(out))


def flipped(path):
    with open(path, "r+b") as file:
        byte = file.read(1)
        file.seek(0)
        file.write(bytes([byte[0] ^ 1]))


def asked_otherwise(line):
    """A ticket of another pulse, as sound as the one that was there; other records as they are."""
    if b'"k":"ticket"' not in line:
        return line
    ticket = json.loads(line[9:])
    ticket["pulse_us"] += 1
    text = json.dumps(ticket).encode()
    return b"%08x %s" % (takes.crc32c(text), text)


def test_every_broken_link_from_plan_to_disk_is_named_by_verify(folder):
    rig = harness.twelve(folder, scene="stamp").start()
    code, status, err = takes.photograph(rig)
    assert code == 0, err
    take = status["id"]
    home = takes.folder(rig, take)
    path = os.path.join(home, "journal")
    with open(path, "rb") as file:
        lines = file.read().split(b"\n")
    tickets = {t["shot"]: t for t in takes.records(rig, take, "ticket")}
    mine, other = tickets[40], tickets[50]

    def names(*words):
        code, out, err = takes.ask(rig, "take", "verify", take)
        assert code == 1, (words, out, err)
        takes.says(out, *words)

    def without(of_line):
        with open(path, "wb") as file:
            file.write(b"\n".join(line for line in lines if not of_line(line)))
    reticketed(path, lines, 40, condition=other["condition"])  # planned
    names(f"shot 40 is of condition {other['condition']}: planned was {mine['condition']}")
    reticketed(path, lines, 40, pulse_us=mine["pulse_us"] + 1)
    names("shot 40 asked for")
    reticketed(path, lines, 40, step=41)
    names("shot 40 is of step 41")
    reticketed(path, lines, 40, controller_us=other["controller_us"])  # fired
    names("shots 40 and 50 were fired by one pulse")
    reticketed(path, lines, 40, camera_ns=other["camera_ns"])  # received
    names("shots (40 and 50|50 and 40) have one frame")
    without(lambda line: b'"k":"ticket"' in line and json.loads(line[9:])["shot"] == 40)
    names("1 of 78 shots have no ticket: 40")
    without(lambda line: b'"k":"published"' in line and b"W-0005" in line)  # stored
    names("cam0/W-0005 is missing")
    reticketed(path, lines, 40)
    assert takes.ask(rig, "take", "verify", take)[0] == 0
    flipped(os.path.join(home, "cam0", "raw", "40-0.raw"))  # checksummed
    names("raw frame of shot 40 is not what its ticket says")
    flipped(os.path.join(home, "cam0", "raw", "40-0.raw"))
    code, out, _ = takes.ask(rig, "take", "verify", take)
    assert code == 0
    takes.says(out, "78 of 78 shots have their ticket")
    with open(path, "wb") as file:
        file.write(b"\n".join(asked_otherwise(line) for line in lines))
    names("shot 0 asked for", "and 14 more like these")  # of 78; the answer holds 64


if __name__ == "__main__":
    harness.main(globals())
