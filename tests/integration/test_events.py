#!/usr/bin/python3 -B
"""What is told while a take runs, and that what is told of can be had at once, as it stays."""
import harness
import takes

CHANNELS = "WR"
PLAN = """subject = "still"; exposures_us = [500, 2500, 12500]; darks = 8; reference = { every = 0; };
conditions = ( { kind = "each"; channels = ["W", "R"]; order = "given"; } );
"""


def read(path):
    with open(path, "rb") as file:
        return file.read()


def fetch(rig, event, name):
    """A single light's picture: (exit code, its bytes, what was said)."""
    code, _, err = takes.ask(rig, "fetch", event["take"], "--channel", event["channel"], "--lights",
                             str(event["light"]), "--estimate", "--half", "--output", rig.path(name))
    path = rig.path(f"{name}.{event['light'] + 1:04d}.exr")
    return code, read(path) if code == 0 else b"", err


def test_a_picture_fetched_at_its_event_is_the_picture_after_the_end(folder):
    rig = harness.twelve(folder, size=128, channels=CHANNELS).start()
    events, ends = takes.Events(rig, "--published"), takes.Events(rig, "--progress")
    takes.begin(rig, PLAN)
    early, told = {}, []
    while len(told) < 24:
        event = events.next("published")
        told.append((event["channel"], event["light"]))
        assert event["condition"] == f"{event['channel']}-{event['light']:04d}", event
        assert event["camera"] == 0, event
        if len(told) == 1:  # the last of its channel: not there, and not called lost
            code, _, err = fetch(rig, dict(event, light=11), "last")
            running = rig.ask("status")["take"]["state"] == "running"
            assert code == 5 and "still runs" in err and "light 11" in err, (code, err)
            assert running, "the take was over before anything could be fetched: make it longer"
        if len(told) in (1, 2, 9):
            code, picture, err = fetch(rig, event, "early")
            assert code == 0 and picture, err
            early[len(told)] = (event, picture)
    assert sorted(told) == sorted((c, i) for c in CHANNELS for i in range(12)), told
    state = "running"
    while state in ("none", "preparing", "running"):
        state = ends.next("progress")["state"]
    assert state == "complete", state
    for event, picture in early.values():
        code, late, err = fetch(rig, event, "late")
        assert code == 0 and late == picture, (event, err)
    events.stop()
    ends.stop()

    # a quarter of the width and the height; a level that is none is said before anybody is asked
    sizes = []
    for level in ("0", "2", "3"):
        code, _, err = takes.ask(rig, "fetch", event["take"], "--channel", "W", "--lights", "0",
                                 "--layout", "rgb", "--level", level, "--output", rig.path("level"))
        assert code == (2 if level == "3" else 0), err
        sizes.append(len(read(rig.path("level.0001.exr"))))
    assert 12 < sizes[0] / sizes[1] < 17, sizes

    # who comes when it is over is told all of it
    late = takes.Events(rig)
    assert sorted((e["channel"], e["light"]) for e in
                  (late.next("published") for _ in range(24))) == sorted(told)
    late.stop()


if __name__ == "__main__":
    harness.main(globals())
