#!/usr/bin/python3 -B
"""Conditions from a file of the user's own, through client and daemon to the lights."""
import json

import harness
import takes
from harness import stage

PLAN = 'subject = "still"; exposures_us = [800, 6400]; darks = 4;\n'
LIST = """{ "format": 1, "conditions": [
    { "id": "rim-left", "channel": "W", "lights": [3, 4, 11], "level": 20000 },
    { "id": "soft-key", "channel": "R", "lights": [0, 7], "levels": [65535, 800] } ] }
"""


def ask(rig, text, *words):
    stage.write(rig.path("list.json"), text)
    return takes.ask(rig, *words, "--plan", takes.plan_file(rig, PLAN), "--custom",
                     rig.path("list.json"))


def test_a_custom_list_is_what_the_lights_do(folder):
    rig = harness.twelve(folder).start()
    with open(f"{harness.ROOT}/daemon/lightstage-plan.5.scd", encoding="utf-8") as file:
        example = file.read().split("```\n{ \"format\": 1", 1)[1].split("```")[0]
    assert json.loads('{ "format": 1' + example) == json.loads(LIST), "the documented example"
    code, out, err = ask(rig, LIST, "take", "start", "--json")
    assert code == 0, err
    status = json.loads(out)
    plan = takes.document(rig, status["id"])["plan"]["conditions"]
    lit = [c for c in plan if c["kind"] != "dark"]
    assert [(c["id"], c["kind"], c["lights"], c["pattern"], c["part"], c["parts"]) for c in lit] == [
        ("rim-left", "segment", [3, 4, 11], "custom", 0, 2),
        ("soft-key", "list", [0, 7], "custom", 1, 2)], lit
    assert lit[1]["levels"] == [65535, 800] and lit[0]["level"] == 20000, lit
    shown = [e for e in harness.shown(rig) if e["kind"] in ("segment", "list")]
    assert [e["n_leds"] for e in shown] == [3, 3, 2, 2], shown
    assert [e["channel"] for e in shown] == [0, 0, 1, 1], shown
    # the hardware has 1000 levels
    assert abs(shown[0]["duty"] - 20000 / 65535) < 0.0005 and shown[2]["duty"] == 1, shown
    assert takes.ask(rig, "take", "verify", status["id"])[0] == 0


def test_a_wrong_list_is_refused_with_its_place_and_reason(folder):
    rig = harness.twelve(folder).start()
    for was, now, words in (
            ('"format": 1', '"format": 1,,', "custom: .*line 1"),
            ('"level": 20000 }', '"level": 20000', r"custom.*line 3"),
            ('"format": 1', '"format": 2', "custom.*format"),
            ("rim-left", "rim/left", r"conditions\[0\].id: expected 1 to 31 letters"),
            ("rim-left", "dark-7", r"conditions\[0\].id: .*daemon's own"),
            ("rim-left", "soft-key", "soft-key is asked for twice"),
            ('"R"', '"X"', r"conditions\[1\].channel: \"X\": the rig has no such channel"),
            ("[0, 7]", "[0, 12]", r"conditions\[1\].lights\[1\]: expected .* 0 to 11, found 12"),
            ("[0, 7]", "[0, 0]", r"conditions\[1\].lights: light 0 stands twice"),
            ("[0, 7]", "[]", r"conditions\[1\].lights: expected a list"),
            ("800]", "65536]", r"conditions\[1\].levels\[1\]: expected .* found 65536"),
            (", 800]", "]", r"conditions\[1\].levels: expected a level for each of 2 lights"),
            ('"level": 20000', '"level": 1.5', r"conditions\[0\].level: expected a whole number"),
            ('"level": 20000', '"Level": 20000', r"conditions\[0\]"),
            ('"level": 20000', '"level": 2, "duty": 3', r"conditions\[0\].duty: unknown key"),
            (LIST, '{ "format": 1, "conditions": [] }', "expected a list of 1 to")):
        assert was in LIST, was
        code, _, err = ask(rig, LIST.replace(was, now, 1), "preflight")
        assert code == 4, (now, code, err)
        takes.says(err, words)
    code, _, err = ask(rig, LIST, "preflight")
    assert code == 0, err
    assert takes.exposures(rig) == 0


if __name__ == "__main__":
    harness.main(globals())
