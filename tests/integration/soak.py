#!/usr/bin/python3 -B
"""Short takes under seeded random mixtures of everything that can go wrong on a stage.

usage: soak.py [--takes N] [--seed FIRST] [--keep] [--slice]

Take k has seed FIRST + k; one that fails prints the line that runs it alone. Verdict of a take:
complete, every stamp equal to its ticket; or the missing shots named, the LEDs dark, and what is
there sound. Whatever ends a take early, it is resumed until it is complete, if its faults pass.
"""
import argparse
import collections
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback

import harness
import takes
from harness import stage

LIGHTS, DARKS = 6, 4
PLAN = f"""subject = "still";
exposures_us = [500, 2500];
darks = {DARKS};
keep_raw = true;
conditions = ( {{ kind = "sphere"; channels = ["W"]; }},
               {{ kind = "each"; channels = ["W", "R"]; }} );
"""
STEPS = 2 + 2 * 2 * LIGHTS                    # of the lights' program
PULSES = takes.WARM_UP + 2 * DARKS + STEPS    # if nothing goes wrong
RESUMES = 8
SLICE = (2, 3, 9, 12, 15, 16, 27, 36)

Fault = collections.namedtuple("Fault", "text passes camera host", defaults=("", True, "", {}))


def pulse(dice):
    return dice.randint(1, PULSES + 5)


def step(dice):
    return dice.randint(0, STEPS - 1)


def by_pulse(kind, *value):
    def make(dice):
        extra = f" value = {dice.uniform(*value):.3f};" if value else ""
        return Fault(f'{{ kind = "{kind}"; at = {pulse(dice)}; count = {dice.randint(1, 3)};'
                     f'{extra} }}')
    return make


def by_step(kind, *value, count=1):
    def make(dice):
        extra = f" value = {dice.uniform(*value):.0f};" if value else ""
        return Fault(f'{{ kind = "{kind}"; at = {step(dice)}; count = {dice.randint(1, count)};'
                     f'{extra} }}')
    return make


def for_ever(make_text):
    """Once in four times it does not pass."""
    def make(dice):
        value = 0 if dice.random() < 0.25 else dice.randint(300, 5000)
        return Fault(make_text(dice, value), passes=value > 0)
    return make


def silent(dice, value):
    return f'{{ kind = "silent"; at = {pulse(dice)}; value = {value}; }}'


def of_controller(kind):
    return for_ever(lambda dice, ms: f'{{ kind = "{kind}"; at = {step(dice)}; value = {ms}; }}')


def of_host(make_host):
    return lambda dice: Fault(host=make_host(dice))


def full_disk(dice):
    return {"LS_ILL_DISK_BYTES": str(dice.randint(20000, 600000))}


def wall_step(dice):
    jump = dice.choice((-86400, -3600, -2, 2, 3600, 86400))
    return {"LS_ILL_WALL_S": str(jump), "LS_ILL_WALL_AFTER_MS": str(dice.randint(100, 3000))}


ANY = {
    "dropped pulse": by_pulse("drop_pulse"),
    "early pulse": by_pulse("early_pulse", 0.06, 15),
    "doubled pulse": by_pulse("double_pulse", 0.05, 15),
    "packet loss": lambda dice: Fault(
        f'{{ kind = "packet_loss"; value = {dice.uniform(0.001, 0.05):.4f}; '
        f'seed = {dice.randint(1, 999)}; }}'),
    "lost leader": by_pulse("lose_leader"),
    "lost frame": by_pulse("lose_frame"),
    "lost last frame": lambda dice: Fault(f'{{ kind = "lose_frame"; at = {PULSES}; }}'),
    "late frame": by_pulse("late_frame", 5, 600),
    "duplicate frame": by_pulse("duplicate_frame"),
    "frame id wraps": lambda dice: Fault(
        camera=f"first_block = {65536 - dice.randint(1, PULSES)};"),
    "camera reboots": lambda dice: Fault(
        f'{{ kind = "reboot"; at = {pulse(dice)}; value = {dice.choice((0, 500, 3000))}; }}'),
    "camera gone": for_ever(silent),
    "controller stalls": by_step("stall", 50, 1500),
    "damaged program": by_step("corrupt"),
    "controller restarts": by_step("restart", 0, 800),
    "controller gone": of_controller("dead"),
    "interlock": by_step("interlock", 100, 1500),
    "emergency stop": by_step("estop", 100, 1500),
    "disk full": of_host(full_disk),
    "wall clock steps": of_host(wall_step),
}
# umockdev does not outlive a program that is killed inside a USB request, so there is none on USB
KILL = {"killed": lambda dice: Fault(host={"kill": pulse(dice)})}
BY_WIRE = {
    "modbus": {**KILL, "connections break": by_step("disconnect")},
    "modbus-rtu": {**KILL, "CRC error": by_step("damage_answer", count=3),
                   "late answer": by_step("late", 50, 1500, count=2)},
    "usb": {"CRC error": by_step("damage_packet", count=4),
            "lost event packet": by_step("lose_packet", count=4),
            "stalled endpoint": by_step("halt"),
            "unplugged": of_controller("disconnect")},
}


def draw(dice):
    """A rig's options and the faults it will suffer: {name: Fault}."""
    wire = dice.choice(("modbus", "modbus", "modbus-rtu", "usb"))
    known = {**ANY, **BY_WIRE[wire]}
    names = dice.sample(sorted(known), dice.choice((1, 1, 2, 2, 3, 4)))
    faults = {name: known[name](dice) for name in names}
    # clocks up to 100 ppm off, each its own way
    camera = (f"clock_drift_ppm = {dice.uniform(-100, 100):.1f}; "
              f"clock_epoch_ticks = {dice.randint(0, 10 ** 15)}L;"
              + "".join(fault.camera for fault in faults.values()))
    controller = f"clock_drift_ppm = {dice.uniform(-100, 100):.1f};"
    daemon_camera = dice.choice(("", "", "", "", "chunks = false;", 'trigger = "software";'))
    options = {"wire": wire, "camera_extra": camera, "cameras": dice.choice((1, 1, 1, 2)),
               "rig_camera_extra": daemon_camera, "controller_extra": controller}
    return options, faults


def build(folder, options, faults):
    texts = [fault.text for fault in faults.values() if fault.text]
    host = {key: value for fault in faults.values() for key, value in fault.host.items()}
    rig = harness.rig_of(
        folder, scene="stamp", size=64, packet_size=1500, timeout_ms=500,
        scene_extra=f"lights = {LIGHTS};",
        simulator_extra=f"faults = ( {', '.join(texts)} );" if texts else "", **options)
    kill = host.pop("kill", None)
    rig.preload, rig.environment = ([harness.ILL_HOST], host) if host else ([], {})
    return rig.start(), kill


class Take:
    """One take from start to verdict."""

    def __init__(self, rig, kill):
        self.rig, self.kill = rig, kill
        self.take, self.resumes, self.said = None, 0, []
        self.files = {}

    def begin(self):
        for _ in range(4):
            code, out, err = takes.ask(self.rig, "take", "start", "--name", "soak", "--token",
                                       f"soak{len(self.said)}", "--plan",
                                       takes.plan_file(self.rig, PLAN), "--json", "--no-wait")
            if code == 0:
                self.take = json.loads(out)["id"]
                return
            self.said.append(err.strip())  # a device that cannot even be opened, or no room at all
            if self.rig.environment:
                self.rig.daemon.stop()
                self.heal()
            time.sleep(1)
        raise AssertionError(f"no take could be started: {self.said}")

    def kill_daemon(self):
        limit = time.monotonic() + 4  # fewer pulses may come than that, for the other faults
        while takes.exposures(self.rig) < self.kill and time.monotonic() < limit:
            time.sleep(0.01)
        self.rig.daemon.kill()
        self.heal()

    def heal(self):
        """A daemon on a healthy host."""
        self.rig.preload, self.rig.environment = [], {}
        self.rig.start_daemon()

    def wait(self):
        """The status of the take that ran last."""
        limit = time.monotonic() + 90
        while time.monotonic() < limit:
            status = self.rig.ask("status")["take"]
            if status and status["state"] not in ("preparing", "running", "none"):
                return status
            time.sleep(0.05)
        raise AssertionError("the take does not end")

    def check(self, status):
        """What is there is sound, what was published stayed; the state says what is missing."""
        rig, take = self.rig, self.take
        document = takes.document(rig, take)
        published = {f"cam{r['camera']}/{r['condition']}" for r in takes.published(rig, take)}
        planned = {f"cam{k}/{c['id']}" for c in document["plan"]["conditions"]
                   for k in range(len(rig.addresses))}
        files = takes.files(rig, take)
        lost = [name for name, data in self.files.items() if files.get(name) != data]
        assert not lost, f"published and lost: {lost}"
        self.files = files
        judged = rig.judge(take)
        assert judged["frames_mislabeled"] == 0, judged
        wrong = takes.mislabeled_pixels(rig, take, only=published)
        assert not wrong, f"{len(wrong)} frames show something else, first {wrong[0]}"
        code, out, err = takes.ask(rig, "take", "verify", take)
        complete = published == planned
        assert (code == 0) == complete, (code, out, err)
        assert " 0 damaged" in out, out
        if status is None:  # killed: nobody was there to say
            return complete
        said = {t["id"]: t["state"] for t in rig.takes()}[take]
        assert (said == "complete") == complete, (said, planned - published)
        if not complete:
            assert status["message"], status
            if said != "open":  # open: the disk was full, nothing more could be written
                assert set(document["missing"]) == planned - published, document["missing"]
            self.is_dark()
        return complete

    def is_dark(self):
        lights = takes.lights_status(self.rig)
        assert not lights["connected"] or lights["state"] not in ("armed",), lights

    def resume(self):
        code, out, err = takes.ask(self.rig, "take", "resume", self.take, "--json", "--no-wait")
        self.resumes += 1
        if code:
            self.said.append(err.strip())
            assert code != 1 and err.strip(), (code, err)
            time.sleep(1)
        return code == 0

    def run(self):
        """Is it complete?"""
        self.begin()
        status = None
        if self.kill is not None:
            self.kill_daemon()
        else:
            status = self.wait()
            self.said.append(status["message"])
        complete = self.check(status)
        while not complete and self.resumes < RESUMES:
            if self.rig.environment:
                self.rig.daemon.stop()
                self.heal()
            if self.resume():
                status = self.wait()
                self.said.append(status["message"])
                complete = self.check(status)
        return complete


def one(seed, keep=False):
    """(verdict, shots); AssertionError or another exception where it went wrong."""
    options, faults = draw(random.Random(seed))
    folder = tempfile.mkdtemp(prefix="ls-")
    began = time.monotonic()
    take = None
    try:
        rig, kill = build(folder, options, faults)
        take = Take(rig, kill)
        complete = take.run()
        assert complete or not all(f.passes for f in faults.values()), \
            f"its faults have passed, and {RESUMES} times resumed it is not complete"
        verdict = "complete" if not take.resumes else "resumed" if complete else "named"
        shots = len({(t["shot"]) for t in takes.records(rig, take.take, "ticket")})
        complaints = [c for r in harness.STANDING for c in r.stop()]
        assert not complaints, complaints
        print(f"# seed {seed}: {verdict}, {take.resumes} resumed, {shots} shots, "
              f"{time.monotonic() - began:.1f} s: {options['wire']}, {options['cameras']} cameras"
              f"{', ' + options['rig_camera_extra'] if options['rig_camera_extra'] else ''}; "
              f"{', '.join(faults)}")
        return verdict, shots
    except Exception:
        print(f"# seed {seed}: {options} {faults}")
        for line in traceback.format_exc().splitlines() + (take.said if take else []):
            print(f"# {line}")
        for log in ("sim.log", "daemon.log"):
            path = os.path.join(folder, log)
            for line in stage.read(path).splitlines()[-10:] if os.path.exists(path) else []:
                print(f"# {log}: {line}")
        raise
    finally:
        for rig in harness.STANDING:
            rig.stop()
        harness.STANDING.clear()
        sys.stdout.flush()
        if keep:
            print(f"# kept: {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)


def tap(seeds):
    print(f"1..{len(seeds)}")
    failed = 0
    for number, seed in enumerate(seeds, 1):
        try:
            verdict, said = one(seed)[0], ""
        except Exception:  # told already
            verdict, said = "failed", "not "
            failed += 1
        print(f"{said}ok {number} - seed {seed} of the soak: {verdict}", flush=True)
        if said:
            print(rerun(seed))
    return 1 if failed else 0


def rerun(seed):
    return f"# FAILED: tests/run soak --takes 1 --seed {seed}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--takes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 1000000)
    parser.add_argument("--keep", action="store_true", help="keep the folders")
    parser.add_argument("--slice", action="store_true", help="eight short ones, as TAP")
    chosen = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # the folders go along
    if chosen.slice:
        return tap(SLICE)
    verdicts, shots, failed = collections.Counter(), 0, []
    for seed in range(chosen.seed, chosen.seed + chosen.takes):
        try:
            verdict, n = one(seed, chosen.keep)
            verdicts[verdict] += 1
            shots += n
        except Exception:  # told already; the others go on
            failed.append(seed)
    print(f"{chosen.takes} takes, seeds from {chosen.seed}: " +
          ", ".join(f"{n} {v}" for v, n in sorted(verdicts.items())) +
          f", {len(failed)} failed; {shots} shots")
    for seed in failed:
        print(rerun(seed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
