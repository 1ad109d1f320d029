"""A take at 72 frames a second: processor time of the receive path, tickets and ring included,
against Aravis' own test program on the same camera in free run; and how late frames are.

Runs on two processors, as tests/run rate does; its figures are of value on an idle machine only.
"""
import json
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import rates  # noqa: E402

FPS = 72
FORMAT = "BayerRG8"


def row(name, unit, value, median, reference, reference_value, wanted=None):
    ratio = value / reference_value if reference_value else None
    print(json.dumps({"name": name, "unit": unit, "value": value, "error": None,
                      "reference": reference, "reference_value": reference_value, "ratio": ratio,
                      "median": median, "wanted": wanted, "at_most": True}))


def main():
    words = sys.argv[1:]
    build = os.path.join(rates.ROOT, "build")
    if "--build" in words:
        build = words[words.index("--build") + 1]
    smoke = "--smoke" in words
    rounds = 1 if smoke else int(words[words.index("--rounds") + 1]) if "--rounds" in words else 3
    side = 256 if smoke else rates.SIDE_PX
    rates.two_processors()
    ours, theirs, late = [], [], []
    for _ in range(rounds):
        result = rates.take(build, side=side, fps=FPS, pixel_format=FORMAT,
                            conditions=20 if smoke else 100)
        ours.append(rates.receiving_ms(result))
        late.append(result["latencies"][0]["frame"])
        theirs.append(rates.free_run_ms(build, side, FPS, FORMAT, 1 if smoke else 4))
        print(f"# {result['fps']:.2f} frames a second, {result['lost']} lost", flush=True)
    theirs = [t for t in theirs if t is not None]
    row("capture_cpu", "ms/frame", min(ours), sorted(ours)[rounds // 2],
        "arv-camera-test-0.8, free run", min(theirs, default=None), 1.5)
    for part in ("p50", "p99", "max"):
        values = sorted(v[f"{part}_ms"] for v in late)
        row(f"capture_latency_{part}", "ms", values[0], values[rounds // 2],
            "a period of 72 Hz", 1e3 / FPS)


if __name__ == "__main__":
    main()
