"""Takes at a camera's full rate on a simulated rig: what they reached, lost, mislabeled and cost.

Simulator and daemon share the first two processors they may run on. Where that is permitted, the
simulator's threads come before the daemon's ordinary ones: a camera's processor is its own.
"""
import json
import mmap
import os
import struct
import subprocess
import sys
import tempfile
import threading
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "sim"))

import rig as stage  # noqa: E402

PROCESSORS = 2
HARDWARE_NICE = -10  # of the simulator: ten times the weight of who has 0
HERE = os.path.dirname(os.path.abspath(__file__))
PULLERS, METRONOME = os.path.join(HERE, "pullers.py"), os.path.join(HERE, "metronome.py")
SIDE_PX = 2048
EXPOSURES_US = (400, 2000, 8000)
CHANNELS = "WRGB"
BLOCKS = 16  # of a stamp, along a side: sim/stamp.h
# A block that differs from the dark's is 0.6 or 3 or 10 high, as the merge believes this exposure or
# that; one that does not is 0 within 0.01
ZERO_SHARE = 0.1
RECEIVING = ("arv_gv_stream", "ls-cam-")  # the threads a frame passes on its way to a ticket
ONE = f"""subject = "still"; exposures_us = [2000]; darks = 2; reference = {{ every = 0; }};
conditions = ( {{ kind = "each"; lights = [0]; channels = ["{CHANNELS[0]}"]; }} );
"""
# Fewer than the eight from which on noisy pixels are looked for: bits of stamps differ from dark to
# dark, and would all be taken for such
DARKS = 4


def two_processors():
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:PROCESSORS])


def threads_s(pid):
    """Processor seconds of every thread of a process: {(name, number): seconds}; of one that has
    ended, nothing."""
    out = {}
    try:
        tasks = os.listdir(f"/proc/{pid}/task")
    except OSError:
        tasks = []
    for task in tasks:
        try:
            with open(f"/proc/{pid}/task/{task}/comm", encoding="utf-8") as file:
                name = file.read().strip()
            with open(f"/proc/{pid}/task/{task}/schedstat", encoding="utf-8") as file:
                out[name, task] = int(file.read().split()[0]) * 1e-9
        except OSError:  # it has ended
            continue
    return out


def prefer(pid):
    """A process's threads, and those they start, before others; as they are where not permitted."""
    for task in os.listdir(f"/proc/{pid}/task"):
        try:
            os.setpriority(os.PRIO_PROCESS, int(task), HARDWARE_NICE)
        except (PermissionError, ProcessLookupError):
            continue


class Metronomes:
    """The pauses of the processors themselves while something goes on."""

    def __enter__(self):
        self.children = [subprocess.Popen([METRONOME, str(processor)], text=True, stdout=subprocess.PIPE,
                                          preexec_fn=stage.die_with_parent)
                         for processor in sorted(os.sched_getaffinity(0))]
        self.tick = all(child.stdout.readline() for child in self.children)
        return self

    def __exit__(self, *_):
        for child in self.children:
            child.terminate()
        texts = [child.communicate()[0] for child in self.children]
        # of each processor, in ms; None: not permitted
        self.pauses_ms = [[float(ms) for ms in text.split()] for text in texts] if self.tick else None


class Account:
    """Processor time of both processes while a take's lights run, by the names of their threads.
    It begins when a bracket of lights is through: darks and the simulator's own preparation are
    no part of the rate."""

    def __init__(self, rig):
        self.pids = {"sim": rig.dome.child.pid, "daemon": rig.daemon.child.pid}
        self.log, self.frames, self.first = rig.path("shown.jsonl"), 0, None
        self.begin = len(rig.addresses) * (DARKS + 1) * len(EXPOSURES_US)
        self.at = os.path.getsize(self.log) if os.path.exists(self.log) else 0
        self.seen, self.done = {}, threading.Event()
        self.before = self.look()
        self.watcher = threading.Thread(target=self.watch)
        self.watcher.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """However it ends: a thread that goes on keeps the program alive."""
        self.done.set()
        self.watcher.join()

    def look(self):
        return {(who, *thread): s for who, pid in self.pids.items()
                for thread, s in threads_s(pid).items()}

    def count(self):
        if not os.path.exists(self.log):
            return
        with open(self.log, "rb") as file:
            file.seek(self.at)
            text = file.read()
        self.at += len(text)
        self.frames += text.count(b'"sent"')

    def watch(self):
        while not self.done.wait(0.1):  # threads that end take what they used with them
            self.count()
            self.seen.update(self.look())
            if self.first is None and self.frames >= self.begin:
                self.before, self.first = dict(self.seen), self.frames

    def ms(self):
        """{"sim camera": ms per frame ...}"""
        self.__exit__()
        self.count()
        self.seen.update(self.look())
        frames = max(1, self.frames - (self.first or 0))
        total = {}
        for (who, name, number), s in self.seen.items():
            name = f"{who} {name.rstrip('0123456789')}"
            total[name] = total.get(name, 0) + s - self.before.get((who, name, number), 0)
        return {name: 1e3 * s / frames for name, s in sorted(total.items()) if s > 0}


def rig_of(build, folder, side, fps, pixel_format, cameras, lights):
    """A rig of one to four cameras of @side x @side, not started."""
    stage.READOUT_PX_PER_S, stage.MAX_FPS = float("inf"), fps
    return stage.Rig(build, folder, size=side, scene="stamp", channels=CHANNELS,
                     scene_extra=f"lights = {lights}; stamp_frames = 2;",
                     camera_extra=f'pixel_format = "{pixel_format}";',
                     pixel_format=pixel_format, cameras=cameras, calibrated=False)


def plan(conditions, exposures_us):
    assert conditions % len(CHANNELS) == 0, f"{conditions} conditions: expected a multiple of {len(CHANNELS)}"
    return f"""subject = "still"; exposures_us = {json.dumps(list(exposures_us))}; darks = {DARKS};
conditions = ( {{ kind = "each"; channels = {json.dumps(list(CHANNELS))}; }} );
"""


# ---- what is in the pixels ----

def blocks(path, side, count):
    """Values in the middle of a stamp's first @count blocks, of an uncompressed tiled OpenEXR file
    of one or two parts whose first has one half channel."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at, parts, heads = 8, data[5] >> 4 & 1, 0
        while not heads or (parts and data[at]):
            while data[at]:
                for _ in range(2):
                    at = data.find(b"\0", at) + 1
                at += 4 + struct.unpack_from("<i", data, at)[0]
            at, heads = at + 1, heads + 1
        at += parts
        block, tile = side // BLOCKS, 64
        out = []
        for k in range(count):
            x, y = k % BLOCKS * block + block // 2, k // BLOCKS * block + block // 2
            index = y // tile * -(-side // tile) + x // tile
            chunk, = struct.unpack_from("<Q", data, at + 8 * index)
            row = min(tile, side - x // tile * tile)
            pixel = chunk + (24 if parts else 20) + 2 * (y % tile * row + x % tile)
            out.append(struct.unpack_from("<e", data, pixel)[0])
        return out


def bits(kind, n_leds, light, channel, camera):
    record = struct.pack("<HHHBB", kind, n_leds, light, channel, camera)
    return [byte >> bit & 1 for byte in record for bit in range(8)]


def mislabeled(rig, take, side, channels):
    """Stored pictures whose pixels show another light, channel or camera than their name says. The
    merge has taken the darks' stamps off: a block is 0 where both have the same bit."""
    folder = rig.path(os.path.join("takes", take))
    wrong = []
    for camera in range(len(rig.addresses)):
        dark = bits(0, 0, 0xffff, 0xff, camera)
        for name in sorted(os.listdir(os.path.join(folder, f"cam{camera}"))):
            channel, _, light = name.split(".")[0].partition("-")
            if channel not in channels or not light.isdigit():
                continue
            lit = bits(1, 1, int(light), channels.index(channel), camera)
            seen = blocks(os.path.join(folder, f"cam{camera}", name), side, len(lit))
            scale = max(map(abs, seen)) * ZERO_SHARE
            if [(v > scale) - (v < -scale) for v in seen] != [a - b for a, b in zip(lit, dark)]:
                wrong.append(f"cam{camera}/{name}")
    return wrong


# ---- a take ----

def pulses_s(rig):
    """Times of the take's pulses, the warm-up's aside."""
    lines = stage.read(rig.path("shown.jsonl")).splitlines()
    shown = [e for e in map(json.loads, lines) if e["camera"] == 0 and e["fate"] == "sent"]
    begun = max((k for k, e in enumerate(shown) if e["step"] == 0), default=0)
    return [e["true_ns"] * 1e-9 for e in shown[begun:]]


def take(build, side=SIDE_PX, fps=72, pixel_format="BayerRG8", cameras=1, conditions=1000,
         exposures_us=EXPOSURES_US, pulled=False):
    """One take to its end; what is known of it as a dictionary. @pulled: while sixteen clients pull
    a picture of a short take before it, four of which never read; "pulled_mb" is what they got."""
    with tempfile.TemporaryDirectory(prefix="ls-rate-") as folder:
        rig = rig_of(build, folder, side, fps, pixel_format, cameras,
                     conditions // len(CHANNELS))
        try:
            rig.start()
            prefer(rig.dome.child.pid)
            short = rig.start_take("pulled", ONE) if pulled else None
            pullers = pull(rig, short) if pulled else None
            with Metronomes() as metronomes:
                result = measure(rig, side, plan(conditions, exposures_us))
            result["pauses_ms"] = metronomes.pauses_ms
            return {**result, "pulled_mb": let_go(pullers) / 1e6} if pulled else result
        finally:
            rig.stop()


def pull(rig, take):
    child = subprocess.Popen([PULLERS, rig.path("socket"), take, "0", CHANNELS[0]], text=True,
                             stdout=subprocess.PIPE, preexec_fn=stage.die_with_parent)
    if child.stdout.readline() != "pulling\n":
        raise stage.Failed("the clients are not served")
    return child


def let_go(child):
    """Bytes that they were given."""
    child.terminate()
    text, _ = child.communicate()
    if child.returncode:
        raise stage.Failed("a client that reads was sent away")
    return int(text)


def measure(rig, side, text):
    stage.write(rig.path("plan.conf"), text)
    with Account(rig) as account:
        done = subprocess.run([rig.program("clients/lightstagectl"), "--socket",
                               rig.path("socket"), "take", "start", "--name", "rate", "--plan",
                               rig.path("plan.conf"), "--json"], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, check=False)
        if not done.stdout:
            raise stage.Failed(done.stderr)
        cost = account.ms()
    status = json.loads(done.stdout)
    at = pulses_s(rig)
    judged = rig.judge(status["id"])
    cameras = rig.ask("metrics")["cameras"]
    return {"state": status["state"], "message": status["message"],
            "fps": (len(at) - 1) / (at[-1] - at[0]) if len(at) > 1 else 0,
            "shots": judged["shots_planned"], "lost": judged["shots_lost"] + status["shots_lost"],
            "mislabeled_in_log": judged["frames_mislabeled"],
            "mislabeled_in_pixels": mislabeled(rig, status["id"], side, CHANNELS),
            "latencies": [c["latencies"] for c in cameras],
            "losses": [{key: c[key] for key in ("steps_unbound", "frames_discarded",
                                                "packets_resent", "underruns") if c[key]}
                       for c in cameras],
            "cpu_ms_per_frame": cost}


def receiving_ms(result):
    """Of the receive path, tickets and ring included."""
    return sum(ms for name, ms in result["cpu_ms_per_frame"].items()
               if name.split(" ", 1)[1].startswith(RECEIVING))


def free_run_ms(build, side, fps, pixel_format, seconds):
    """Processor time per frame of Aravis' own test program, from the same camera in free run at
    @fps; None where it is not installed."""
    with tempfile.TemporaryDirectory(prefix="ls-rate-") as folder:
        rig = rig_of(build, folder, side, fps, pixel_format, 1, 12)
        try:
            rig.start_simulator()
            command = ["arv-camera-test-0.8", "-n", rig.addresses[0], "-f", str(fps), "-e", "2000",
                       "-i", "9000", "-j", "never", "--duration", str(seconds)]
            try:
                child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True,
                                         stderr=subprocess.DEVNULL)
            except FileNotFoundError:
                return None
            text = child.stdout.read()
            _, _, used = os.wait4(child.pid, 0)
            frames = int(text.split("n_completed_buffers")[1].split("=")[1].split()[0])
            return 1e3 * (used.ru_utime + used.ru_stime) / frames
        finally:
            rig.stop()
