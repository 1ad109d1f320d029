#!/usr/bin/python3 -B
"""lightstage-render, and the daemon without a rig that it starts for a folder."""
import os

import numpy as np

import harness
import pictures


def serving(folder):
    """A daemon that serves the takes of a folder and has no rig: (it, how its clients ask it)."""
    config, socket = os.path.join(folder, "serve.conf"), os.path.join(folder, "serve")
    harness.stage.write(config, f'storage = "{folder}/takes"; socket = "{socket}";')
    child = harness.stage.Process(os.path.join(folder, "serve.log"),
                                  os.path.join(harness.BUILD, "daemon", "lightstaged"), "--config",
                                  config)

    def ask(*words):
        return harness.stage.call(os.path.join(harness.BUILD, "clients", "lightstagectl"),
                                  "--socket", socket, *words)
    return child, ask


def test_a_daemon_without_a_rig_serves_takes_and_refuses_what_needs_one(folder):
    rig = harness.twelve(folder).start()
    take = rig.start_take("served", harness.PLAN)
    options = ("--channel", "R", "--lights", "3", "--model", "sphere", "--layout", "rgb", "--output")
    rig.control("fetch", take, *options, rig.path("with"))
    assert not rig.stop()
    child, ask = serving(folder)
    ask("fetch", take, *options, rig.path("without"))
    assert np.array_equal(pictures.read(rig.path("with.0004.exr")),
                          pictures.read(rig.path("without.0004.exr")))
    ask("take", "verify", take)
    assert take in ask("take", "list")
    assert "not connected" in ask("status")
    plan = rig.path("plan.conf")
    for words in (("blank",), ("preflight", "--plan", plan), ("take", "start", "--name", "x", "--plan", plan),
                  ("take", "resume", take)):
        harness.refuses("its configuration names no rig (108", lambda w=words: ask(*w))
    wrong = child.stop()
    assert not wrong, wrong


harness.main(globals())
