#!/usr/bin/python3 -B
"""Clients on other machines: by TLS as operator and as reader; those who only knock at the port."""
import os
import socket

import numpy as np

import harness
import pictures
import takes

LISTEN = """listen = { port = 0; certificate = "pki/server.pem"; key = "pki/server.key";
  authority = "pki/authority.pem"; operators = ["operator"]; readers = ["reader"]; };"""
KNOCKS = 50


def with_port(folder):
    """A rig that listens for TLS, with the certificates of `pki init`."""
    rig = harness.twelve(folder, daemon_extra=LISTEN)
    rig.control("pki", "init", rig.path("pki"))
    rig.start()
    assert rig.daemon.ready["tls"].startswith("127.0.0.1:"), rig.daemon.ready
    return rig


def as_(rig, name, pki="pki"):
    """The options of a client that is called so."""
    return ("--server", "tls://" + rig.daemon.ready["tls"], "--certificate",
            rig.path(f"{pki}/{name}.pem"), "--key", rig.path(f"{pki}/{name}.key"),
            "--authority", rig.path("pki/authority.pem"))


def fetched(rig, take, model, name, *who):
    rig.control("fetch", take, "--channel", "R", "--lights", "0,7", "--model", model,
                "--layout", "rgb", "--output", rig.path(name), *who)
    return [pictures.read(rig.path(f"{name}.{light:04d}.exr")) for light in (1, 8)]


def test_an_operator_photographs_and_a_reader_fetches_the_same_bits_as_at_the_socket(folder):
    rig = with_port(folder)
    take = rig.start_take("remote", harness.PLAN, *as_(rig, "operator"))
    assert rig.takes()[-1]["state"] == "complete", rig.takes()
    here = fetched(rig, take, "sphere", "here")
    for who in "operator", "reader":
        for ours, theirs in zip(here, fetched(rig, take, "sphere", who, *as_(rig, who))):
            assert ours.any() and np.array_equal(ours, theirs), who
    assert 'take started by certificate "operator"' in harness.stage.read(rig.path("daemon.log"))


def test_a_reader_fires_no_light(folder):
    rig = with_port(folder)
    who = as_(rig, "reader")
    harness.stage.write(rig.path("plan.conf"), harness.PLAN)
    before = len(harness.shown(rig))
    for command in (("take", "start", "--plan", rig.path("plan.conf")), ("blank",), ("take", "abort"),
                    ("preflight", "--plan", rig.path("plan.conf")), ("preview", "--exposure", "20000")):
        code, _, err = takes.ask(rig, *command, *who)
        assert code == 4 and "is a reader here" in err and "(110" in err, (command, code, err)
    assert rig.takes() == [] and len(harness.shown(rig)) == before
    assert takes.ask(rig, "status", *who)[0] == 0


def test_who_is_not_known_stays_out_and_both_ends_say_why(folder):
    rig = with_port(folder)
    rig.control("pki", "init", rig.path("other"))
    rig.control("pki", "add", rig.path("pki"), "visitor")
    code, _, err = takes.ask(rig, "status", *as_(rig, "reader", "other"))
    assert code == 3 and "unknown ca" in err, (code, err)
    code, _, err = takes.ask(rig, "status", *as_(rig, "visitor"))
    assert code == 3 and "neither an operator nor a reader" in err, (code, err)
    log = harness.stage.read(rig.path("daemon.log"))
    assert "its certificate: unable to get local issuer certificate" in log, log
    assert 'certificate "visitor" is turned away' in log, log


def test_those_who_only_knock_cost_a_take_nothing(folder):
    rig = with_port(folder)
    host, port = rig.daemon.ready["tls"].rsplit(":", 1)
    rig.start_take("knocked", takes.LONG, "--no-wait", *as_(rig, "operator"))
    crowd = [socket.create_connection((host, int(port))) for _ in range(KNOCKS)]
    for i, peer in enumerate(crowd):
        peer.sendall((b"", b"\x16\x03\x01\x02\x00\x01", os.urandom(64))[i % 3])
    assert takes.ask(rig, "status", *as_(rig, "reader"))[0] == 0
    harness.wait_for("the take is complete", lambda: rig.takes()[-1]["state"] == "complete")
    for peer in crowd:
        peer.close()


harness.main(globals())
