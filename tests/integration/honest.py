"""A client that does what it should, in a process of its own, while others do not."""
import multiprocessing
import time

import harness  # noqa: F401, which finds the package
import lightstage


def _serve(path, take, stop, pipe):
    seconds, first, wrong = {"status": [], "fetch": []}, None, None
    try:
        with lightstage.connect(path, timeout=30) as stage:
            ask = {"status": stage.status,
                   "fetch": lambda: stage.fetch(take, "W", lights=[0]).pixels.tobytes()}
            while not stop.is_set() and not wrong:
                for name, request in ask.items():
                    began = time.monotonic()
                    answer = request()
                    seconds[name].append(time.monotonic() - began)
                    first = answer if name == "fetch" and first is None else first
                    if name == "fetch" and answer != first:
                        wrong = "a fetch brought other bytes than the first"
                if len(seconds["status"]) == 1:
                    pipe.send("ready")
                time.sleep(0.005)  # a person's client, not a flood of its own
    except (lightstage.Error, OSError) as error:
        wrong = repr(error)
    pipe.send((wrong, seconds))


class Client:
    """Asks for the status and for a light's picture until it is told to stop."""

    def __init__(self, path, take):
        context = multiprocessing.get_context("fork")
        self.stop, (self.pipe, other) = context.Event(), context.Pipe()
        self.process = context.Process(target=_serve, args=(path, take, self.stop, other),
                                       daemon=True)
        self.process.start()
        said = self.pipe.recv()
        assert said == "ready", said

    def ended(self):
        """Every answer was right; the seconds that each took, by request."""
        self.stop.set()
        assert self.pipe.poll(30), "the honest client waits for an answer"
        wrong, seconds = self.pipe.recv()
        self.process.join(10)
        assert not wrong, wrong
        return seconds


def resident(rig):
    """Bytes of the daemon's memory that are its own: pictures that it has mapped are the
    kernel's to take back."""
    return sizes(rig)["RssAnon"]


def sizes(rig):
    """Bytes of the daemon that are in memory, by the names of proc(5)."""
    with open(f"/proc/{rig.daemon.child.pid}/status", encoding="ascii") as file:
        fields = dict(line.split(":", 1) for line in file)
    return {name: 1024 * int(value.split()[0]) for name, value in fields.items()
            if name.startswith("Rss") or name == "VmRSS"}
