#!/usr/bin/python3 -B
"""lightstaged under a service manager's protocol: readiness, watchdog, a socket handed over."""
import os
import signal
import socket
import subprocess

import harness
import takes
from harness import stage


def prepared(folder):
    """A rig whose simulator runs and whose daemon is configured, not started."""
    rig = harness.twelve(folder)
    rig.start_simulator()
    rig.write_configuration()
    return rig


def test_it_says_ready_beats_the_watchdog_and_says_when_it_stops(folder):
    rig = prepared(folder)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.bind(rig.path("notify"))
        notify.settimeout(30)
        rig.daemon = stage.Process(
            rig.path("daemon.log"), rig.program("daemon/lightstaged"), "--config",
            rig.path("daemon.conf"),
            environment={"NOTIFY_SOCKET": rig.path("notify"), "WATCHDOG_USEC": "3000000"})
        said = [notify.recv(4096).decode()]
        notify.settimeout(3)  # as long as it was given
        said += [notify.recv(4096).decode() for _ in range(2)]
        assert said[0].startswith("READY=1\nSTATUS="), said
        assert said[1:] == 2 * ["WATCHDOG=1"], said
        rig.daemon.child.send_signal(signal.SIGTERM)
        while notify.recv(4096).decode() != "STOPPING=1":
            pass
        assert rig.daemon.stop() is None  # another SIGTERM changes nothing


def test_which_privileges_it_lacks_is_said_at_start_in_status_and_in_preflight(folder):
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
    except PermissionError:
        raise harness.Skip("CAP_NET_RAW is missing to begin with")
    rig = prepared(folder)
    plan = takes.plan_file(rig, harness.PLAN)
    daemon = (rig.program("daemon/lightstaged"), "--config", rig.path("daemon.conf"))
    for wrapper in ((), (harness.need("setpriv"), "--bounding-set=-net_raw")):
        rig.daemon = stage.Process(rig.path("daemon.log"), *wrapper, *daemon)
        lacks = bool(wrapper)
        status, warned = takes.ask(rig, "status")[1], takes.ask(rig, "preflight", "--plan", plan)[1]
        assert ("serial SIM0, UDP" if lacks else "serial SIM0, packet socket") in status, status
        assert ("camera 0 is received over UDP: without CAP_NET_RAW" in warned) == lacks, warned
        for text in (status, stage.read(rig.path("daemon.log"))):
            assert ("CAP_NET_RAW (frames through a packet socket" in text) == lacks, text
        assert rig.daemon.stop() is None
        rig.daemon = None


def test_its_threads_are_real_time_and_its_ring_is_locked_where_that_is_allowed(folder):
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except PermissionError:
        raise harness.Skip("CAP_SYS_NICE is missing")
    if harness.SANITIZED:
        raise harness.Skip("a sanitizer locks no memory")
    rig = harness.twelve(folder).start()
    pid = rig.daemon.child.pid
    takes.begin(rig, takes.LONG)
    takes.fire(rig, takes.FIRST_LIGHT)
    policies = {}
    for task in os.listdir(f"/proc/{pid}/task"):
        name = stage.read(f"/proc/{pid}/task/{task}/comm").strip()
        policies[name] = os.sched_getscheduler(int(task)), os.sched_getparam(int(task)).sched_priority
    seq, cam = policies["ls-seq"], policies["ls-cam-0"]
    assert seq[0] == cam[0] == os.SCHED_FIFO and 0 < seq[1] < cam[1], policies
    assert policies["ls-merge-0"][0] == policies["ls-store"][0] == os.SCHED_OTHER, policies
    locked_kb = [int(line.split()[1]) for line in stage.read(f"/proc/{pid}/status").splitlines()
                 if line.startswith("VmLck:")]
    assert locked_kb[0] >= 32 * 128 * 128 / 1024, locked_kb  # 32 slots of 128 x 128 px
    assert takes.ask(rig, "take", "abort")[0] == 0


def test_the_first_client_starts_it_by_its_socket(folder):
    activate = harness.need("systemd-socket-activate")
    rig = prepared(folder)
    with open(rig.path("daemon.log"), "w", encoding="utf-8") as log:
        daemon = subprocess.Popen(
            [activate, "-l", rig.path("socket"), rig.program("daemon/lightstaged"), "--config",
             rig.path("daemon.conf")], stderr=log, stdin=subprocess.DEVNULL,
            preexec_fn=stage.die_with_parent)
    harness.wait_for("the socket is there", lambda: os.path.exists(rig.path("socket")))
    assert rig.ask("status")["lights"]["connected"]
    daemon.send_signal(signal.SIGTERM)
    assert daemon.wait(30) == 0, stage.read(rig.path("daemon.log"))
    assert os.path.exists(rig.path("socket")), "it removed a socket that is not its own"


def test_a_socket_of_another_path_is_refused(folder):
    activate = harness.need("systemd-socket-activate")
    rig = prepared(folder)
    other = rig.path("other")
    daemon = subprocess.Popen(
        [activate, "-l", other, rig.program("daemon/lightstaged"), "--config",
         rig.path("daemon.conf")], stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True,
        preexec_fn=stage.die_with_parent)
    harness.wait_for("the socket is there", lambda: os.path.exists(other))
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(other)
        _, said = daemon.communicate(timeout=30)
    assert daemon.returncode == 1 and "ListenStream=" in said, (daemon.returncode, said)


def test_the_units_are_as_systemd_wants_them(folder):
    analyze = harness.need("systemd-analyze")
    units = os.path.join(folder, "units")
    os.mkdir(units)
    service = stage.read(os.path.join(harness.BUILD, "daemon", "lightstaged.service"))
    lines = [f"ExecStart={harness.BUILD}/daemon/lightstaged --config /etc/lightstaged/daemon.conf"
             if line.startswith("ExecStart=") else line for line in service.splitlines()]
    assert any(line.startswith("ExecStart=") for line in lines)
    # without the second, stopping the service removes the folder, and the socket unit's socket in it
    assert "RuntimeDirectory=lightstaged" in lines and "RuntimeDirectoryPreserve=yes" in lines
    stage.write(os.path.join(units, "lightstaged.service"), "\n".join(lines) + "\n")
    stage.write(os.path.join(units, "lightstaged.socket"),
                stage.read(os.path.join(harness.ROOT, "daemon", "lightstaged.socket")))
    done = subprocess.run([analyze, "verify", "--man=no", "lightstaged.service",
                           "lightstaged.socket"], cwd=units, capture_output=True, text=True,
                          timeout=60, check=False, env={**os.environ, "SYSTEMD_UNIT_PATH": units + ":"})
    ours = [line for line in done.stderr.splitlines() if "lightstaged" in line]
    assert done.returncode == 0 and not ours, (done.returncode, done.stderr)


if __name__ == "__main__":
    harness.main(globals())
