#!/usr/bin/python3 -B
"""The README's first command, small: what it prints, what it writes, what it leaves behind."""
import json
import os
import subprocess

import harness

KEYS = ["lights", "channels", "width", "height", "shots_planned", "shots_stored", "shots_lost",
        "shots_repaired", "frames_mislabeled", "take_seconds", "frames_per_second", "calibration",
        "model",
        "promotion_error_percent", "promotion_error_by_channel", "olat_mae_percent",
        "field_rms_percent", "interreflection_rms_percent", "highlight_rms_percent",
        "relight_error_percent", "tristimulus_error_percent", "paper_mse_chart_percent",
        "paper_mse_fabric_percent", "paper_rms_percent", "black_mean_sigma",
        "relight_seconds", "verdict"]


def demo(folder, *arguments):
    """Run it with its temporary folders inside ours."""
    return subprocess.run([harness.ROOT + "/sim/demo", *arguments], capture_output=True, text=True,
                          env={**os.environ, "TMPDIR": folder}, timeout=280,
                          stdin=subprocess.DEVNULL)


def left_behind(folder):
    """Command lines of processes that still name the folder."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/cmdline", "rb") as file:
                line = file.read().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if folder in line:
            found.append(line)
    return found


def test_the_demo_says_ok_and_leaves_nothing_behind(folder):
    numbers = os.path.join(folder, "numbers.json")
    done = demo(folder, "--size", "128", "--json", numbers)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "verdict: ok", done.stdout
    with open(numbers, encoding="utf-8") as file:
        result = json.load(file)
    assert sorted(result) == sorted(KEYS), sorted(set(result) ^ set(KEYS))
    assert result["lights"] == 346 and result["shots_stored"] == result["shots_planned"], result
    assert list(result["promotion_error_by_channel"]) == list("RAGCB"), result
    assert os.listdir(folder) == ["numbers.json"], os.listdir(folder)
    assert not left_behind(folder), left_behind(folder)


CALIBRATION_KEYS = ["calibrate_seconds", "k_lights", "k_error_percent", "k_worst_percent",
                    "k_within_sigma_percent", "k_within_sigma_by_channel", "k_common_error_sigma",
                    "direction_error_deg", "direction_worst_deg", "chrome_direction_error_deg",
                    "droop_error_percent",
                    "droop_error_by_pattern", "p_error_percent",
                    "scale_error_percent", "mirror_reflectivity", "polarisation_error",
                    "polarisation_lights"]


def test_the_demo_measures_its_own_calibration(folder):
    if "LS_TEST_FULL" not in os.environ:
        raise harness.Skip("two minutes; LS_TEST_FULL runs it, and test_calibrate what it is made of")
    numbers = os.path.join(folder, "numbers.json")
    done = demo(folder, "--size", "256", "--spread", "0.1", "--calibrate", "--json", numbers)
    assert done.returncode == 0, done.stdout + done.stderr
    with open(numbers, encoding="utf-8") as file:
        result = json.load(file)
    assert sorted(result) == sorted(KEYS + CALIBRATION_KEYS), sorted(result)
    assert result["calibration"] == "measured", result
    table = done.stdout.split("calibration  ")[1].split("\n==")[0].splitlines()[1:]
    assert len(table) == 18 and all(line.endswith("ok") for line in table[1:]), done.stdout
    assert not left_behind(folder), left_behind(folder)


def test_the_demo_refuses_what_it_does_not_know(folder):
    for arguments in (["--size", "63"], ["--size", "many"], ["--sise", "512"],
                      ["--size", "252", "--calibrate"], ["--spread", "0.3"]):
        done = demo(folder, *arguments)
        assert done.returncode == 2 and "usage" in done.stderr, (arguments, done)


if __name__ == "__main__":
    harness.main(globals())
