"""What a live subject saw, out of the simulator's log: flashes, and how they follow each other."""
import harness

LOW_HZ, HIGH_HZ = 3, 30


def pulses(rig):
    """Lit pulses in the order of time: (seconds, what was lit), once each however many cameras."""
    return [(e["true_ns"] * 1e-9, (e["channel"], e["hash"])) for e in harness.shown(rig)
            if e["kind"] != "dark" and e["camera"] == 0]


def closest_s(times):
    """The least time between the beginnings of two flashes. Light that comes back within a period
    of the band's upper end is one flash, as the eye does not see it go."""
    begun = [t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > 1 / HIGH_HZ]
    return min((b - a for a, b in zip(begun, begun[1:])), default=float("inf"))


def spares(rig):
    """Neither the pulses, nor those of one colour, nor the changes of light flash within the
    band."""
    seen = pulses(rig)
    changes = [t for k, (t, light) in enumerate(seen) if k == 0 or light != seen[k - 1][1]]
    sights = {"pulses": [t for t, _ in seen], "changes of light": changes}
    for channel in {light[0] for _, light in seen}:
        sights[f"channel {channel}"] = [t for t, light in seen if light[0] == channel]
    for name, times in sights.items():
        least = closest_s(times)
        assert least >= 1 / LOW_HZ, f"{name}: two flashes {least:.3f} s apart"
