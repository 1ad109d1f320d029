#!/usr/bin/python3 -B
"""Does a take keep a camera's full rate, and lose and mislabel nothing? On an idle machine.

usage: tests/run rate [--quick] [--clients] [--build DIR]

Three takes on two processors, simulator and daemon together: one camera at 72 frames a second, 8
bits; four at 18; one at 36 in 12 bits, two bytes a pixel; 2048 x 2048 and three exposures each, merge
and store on. 1,000 conditions each, which take five minutes and up to 35 GB below TMPDIR; --quick: 100.
Prints what each reached and cost, and ends with 1 unless all kept 99.3 % of their rate, lost nothing
at the first attempt, and every frame and picture showed what its label says.

--clients: instead, the first take alone and again while 16 clients pull pictures as fast as they
come, 4 of which never read: nothing lost, and the p99 of what a frame takes from its trigger to its
ticket at most doubled.
"""
import os
import signal
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import rates  # noqa: E402

KEPT = 71.5 / 72  # of the planned rate
RUNS = (("one camera, 8 bit", {"fps": 72}),
        ("four cameras, 8 bit", {"fps": 18, "cameras": 4}),
        ("one camera, 12 bit", {"fps": 36, "pixel_format": "BayerRG12"}))


def faults(result, fps):
    """What speaks against a run, in words."""
    if result["state"] != "complete":
        yield result["message"]
    if result["fps"] < KEPT * fps:
        yield f"{result['fps']:.2f} frames a second, {KEPT * fps:.2f} wanted"
    if result["lost"]:
        yield f"{result['lost']} shots lost at the first attempt"
    if result["mislabeled_in_log"] or result["mislabeled_in_pixels"]:
        yield (f"{result['mislabeled_in_log']} frames mislabeled by the log, pictures by their "
               f"pixels: {result['mislabeled_in_pixels'][:3]}")


def show(name, result, fps, wrong):
    print(f"{name}: {result['fps']:.2f} of {fps} frames a second, {result['shots']} shots, "
          f"{result['lost']} lost, {result['mislabeled_in_log']} frames and "
          f"{len(result['mislabeled_in_pixels'])} pictures mislabeled")
    for camera, parts in enumerate(result["latencies"]):
        line = ", ".join(f"{part} {v['p50_ms']:.1f} / {v['p99_ms']:.1f} / {v['max_ms']:.1f}"
                         for part, v in parts.items())
        print(f"  camera {camera}: latency p50 / p99 / max in ms: {line}")
        if result["losses"][camera]:
            print(f"  camera {camera}: {result['losses'][camera]}")
    for processor, pauses in enumerate(result["pauses_ms"] or []):
        if pauses:
            print(f"  processor {processor} stood still {len(pauses)} times, {sum(pauses):.0f} ms in all, "
                  f"{max(pauses):.0f} at most: no thread ran, of whatever priority")
    cost = result["cpu_ms_per_frame"]
    for part, ms in sorted(cost.items(), key=lambda item: -item[1]):
        if ms >= 0.05:
            print(f"  {part:28} {ms:7.2f} ms of a processor per frame")
    views = 4 if "four" in name else 1
    print(f"  {'together':28} {sum(cost.values()):7.2f} ms of the "
          f"{1e3 * rates.PROCESSORS / (fps * views):.2f} there are")
    for text in wrong:
        print(f"  NOT MET: {text}")


def p99_ms(result):
    """Of the cameras' frames, the worst camera's."""
    return max(parts["frame"]["p99_ms"] for parts in result["latencies"])


def beside_clients(build, conditions):
    """Verdicts of both takes: [what speaks against it ...]."""
    name, options = RUNS[0]
    verdicts, alone = [], None
    for pulled in (False, True):
        result = rates.take(build, conditions=conditions, pulled=pulled, **options)
        wrong = list(faults(result, options["fps"]))
        if pulled and p99_ms(result) > 2 * alone:
            wrong.append(f"p99 of the frames' latency {p99_ms(result):.1f} ms, {alone:.1f} alone")
        alone = alone or p99_ms(result)
        show(f"{name}, 16 clients" if pulled else f"{name}, alone", result, options["fps"], wrong)
        if pulled:
            print(f"  {result['pulled_mb']:.0f} MB pulled meanwhile")
        sys.stdout.flush()
        verdicts.append(wrong)
    return verdicts


def each(build, conditions):
    verdicts = []
    for name, options in RUNS:
        result = rates.take(build, conditions=conditions, **options)
        verdicts.append(list(faults(result, options["fps"])))
        show(name, result, options["fps"], verdicts[-1])
        sys.stdout.flush()
    return verdicts


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # the pictures go with their folder
    words = sys.argv[1:]
    build = os.path.join(rates.ROOT, "build")
    if "--build" in words[:-1]:
        at = words.index("--build")
        build = os.path.abspath(words[at + 1])
        del words[at:at + 2]
    if set(words) - {"--quick", "--clients"}:
        sys.exit(__doc__)
    rates.two_processors()
    print(f"load average {os.getloadavg()[0]:.2f} before")
    run = beside_clients if "--clients" in words else each
    verdicts = run(build, 100 if "--quick" in words else 1000)
    met = sum(not wrong for wrong in verdicts)
    print(f"{met} passed, {len(verdicts) - met} failed")
    return 0 if met == len(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
