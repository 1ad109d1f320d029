#!/usr/bin/python3 -B
"""What a take counted, as the client prints it: each fault of the simulator where it belongs."""
import harness
import takes

# Faults are camera 0's, the front one. The late frame comes 60 ms late, four frames later; the
# duplicate is of a step that is bound already.
FAULTS = f"""{{ kind = "drop_pulse"; at = {takes.FIRST_LIGHT + 4}; }},
{{ kind = "lose_frame"; at = {takes.FIRST_LIGHT + 20}; }},
{{ kind = "late_frame"; at = {takes.FIRST_LIGHT + 34}; value = 60; }}"""
SHOTS = takes.DARKS + takes.LIGHTS


def by_name(metrics):
    return {camera["name"]: camera for camera in metrics["cameras"]}


def prometheus(text):
    """Samples by name and labels, as Prometheus' own parser reads them."""
    try:
        from prometheus_client.parser import text_string_to_metric_families
    except ImportError:
        raise harness.Skip("python3-prometheus-client is not installed") from None
    return {(s.name, *sorted(s.labels.items())): s.value
            for family in text_string_to_metric_families(text) for s in family.samples}


def test_faults_count_at_the_camera_and_for_the_reason_they_had(folder):
    rig = harness.twelve(folder, FAULTS, scene="stamp", cameras=2).start()
    before = rig.ask("metrics")
    assert before["pulses"] == 0 and before["takes_complete"] == 0, before
    code, status, err = takes.photograph(rig)
    assert code == 0, (err, status)
    judged = takes.is_good(rig, status["id"])
    metrics = rig.ask("metrics")
    front, left = by_name(metrics)["front"], by_name(metrics)["left"]
    assert metrics["takes_complete"] == 1 and not metrics["take_running"], metrics

    # camera 1 saw nothing wrong, and camera 0's shots that were lost were all repaired
    assert left["shots_lost"] == 0 and not left["steps_unbound"], left
    assert front["shots_lost"] >= front["shots_repaired"] == judged["shots_repaired"] >= 2, front
    assert sum(front["steps_unbound"].values()) == front["shots_lost"], front
    assert front["steps_unbound"]["no_frame"] >= 1, front
    # every pulse that reached a camera gave a frame, bound or discarded; the lost one never came
    # whole, and the dropped one never was
    arrived = front["frames_bound"] + sum(front["frames_discarded"].values())
    lost = len(harness.shown(rig, "lost_frame"))
    assert lost == 1 and metrics["pulses"] - 1 - lost <= arrived <= metrics["pulses"] - 1, front
    assert left["frames_bound"] == metrics["pulses"] == SHOTS + front["shots_lost"], metrics

    # latencies: of every frame bound and of every picture stored, and the late one is the largest
    for camera in front, left:
        part = camera["latencies"]
        assert part["frame"]["count"] == camera["frames_bound"], part
        assert part["merged"]["count"] == part["stored"]["count"] == part["total"]["count"] == 21
        for p in part.values():
            assert 0 <= p["p50_ms"] <= p["p99_ms"] <= p["max_ms"], part
        assert part["total"]["max_ms"] >= part["stored"]["max_ms"], part
    assert front["latencies"]["frame"]["max_ms"] >= 60, front["latencies"]


def test_prometheus_reads_the_same_numbers(folder):
    rig = harness.twelve(folder).start()
    code, status, err = takes.photograph(rig, harness.PLAN)
    assert code == 0, (err, status)
    file = rig.path("lightstage.prom")
    rig.control("metrics", "--prometheus", "--output", file)
    metrics, text = rig.ask("metrics"), harness.stage.read(file)
    assert rig.control("metrics", "--prometheus") == text
    samples = prometheus(text)
    front, camera = by_name(metrics)["front"], ("camera", "front")
    assert samples[("lightstage_pulses_total",)] == metrics["pulses"] == SHOTS
    assert samples[("lightstage_takes_total", ("state", "complete"))] == 1
    assert samples[("lightstage_frames_bound_total", camera)] == SHOTS
    for part, numbers in front["latencies"].items():
        labels = (camera, ("part", part))
        assert samples[("lightstage_latency_seconds_count", *labels)] == numbers["count"]
        quantile = samples[("lightstage_latency_quantile_seconds", *labels, ("quantile", "0.99"))]
        assert abs(quantile * 1e3 - numbers["p99_ms"]) < 1e-5, (quantile, numbers)
        buckets = sorted((float(dict(key[1:])["le"]), value) for key, value in samples.items()
                         if key[0] == "lightstage_latency_seconds_bucket" and labels[1] in key)
        counts = [value for _, value in buckets]
        assert counts == sorted(counts) and counts[-1] == numbers["count"], buckets
        # 99 of 100 are no longer than p99; the next border above it has them below it
        above = next(value for border, value in buckets if border > quantile * 65 / 64)
        assert above >= 0.99 * numbers["count"], (buckets, numbers)


if __name__ == "__main__":
    harness.main(globals())
