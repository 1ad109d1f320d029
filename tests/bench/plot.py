"""Run time against error and pictures against error, as one figure; run writes it."""
import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402, a backend comes first
from matplotlib import ticker  # noqa: E402

INK, ACCENT, PALE = "#222222", "#b5452c", "#8a8a8a"
LABELS = {
    "half_gradient": "half, gradient", "half_gradient_half_out": "half in and out, gradient",
    "float_gradient": "float, gradient", "half_bilinear": "half, bilinear",
    "skip_1e-4": "skip $10^{-4}$", "skip_1e-3": "skip $10^{-3}$", "skip_1e-2": "skip $10^{-2}$",
    "linear_14": "linear, G = 14", "linear_6": "G = 6", "linear_26": "G = 26",
    "measured": "measured", "separated": "separated", "sphere": "sphere", "headlight": "head light",
}


def points(rows, prefix):
    """{way: row} of the rows named PREFIX_way."""
    return {row["name"][len(prefix) + 1:]: row for row in rows
            if row["name"].startswith(prefix + "_") and row["name"][len(prefix) + 1:] in LABELS}


def mark(axes, x, y, text, offset=(6, 4), **style):
    axes.plot([x], [y], "o", color=style.pop("color", INK), ms=6, **style)
    axes.annotate(text, (x, y), xytext=offset, textcoords="offset points", fontsize=9,
                  ha="left" if offset[0] >= 0 else "right", va="center")


def against_truth(axes, rows):
    offsets = {"half_gradient": (6, -9), "half_gradient_half_out": (7, 9)}
    for way in ("half_gradient", "half_gradient_half_out", "float_gradient", "half_bilinear"):
        row = points(rows, "truth")[way]
        mark(axes, 1e3 * row["value"], 100 * row["error"], LABELS[way], offsets.get(way, (7, 0)))
    axes.set_ylim(0, 1.15 * axes.get_ylim()[1])
    axes.set_xlim(0, 1.45 * axes.get_xlim()[1])
    axes.set(title="Storage and demosaic", xlabel="relight, median, ms",
             ylabel="RMS difference from the truth, % of white")


def against_exact(axes, rows):
    bounds = points(rows, "bound")
    for way, row in points(rows, "exact").items():
        x = 1e3 * row["value"]
        if way in bounds:
            happened, bound = bounds[way]["value"], bounds[way]["reference_value"]
            if bound > 0:
                axes.plot([x, x], [row["error"], bound], ":", color=PALE, lw=1)
                axes.plot([x], [bound], "v", color=ACCENT, ms=6, mfc="none")
            if happened > 0:
                axes.plot([x], [happened], "_", color=INK, ms=9)
        if row["error"] > 0:
            storage = "" if way in bounds else "\n(against a field of floats)"
            mark(axes, x, row["error"], LABELS[way] + storage)
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low, high + 0.45 * (high - low))
    axes.plot([], [], "o", color=INK, label="RMS")
    axes.plot([], [], "_", color=INK, ms=9, label="largest, before promotion")
    axes.plot([], [], "v", color=ACCENT, mfc="none", label="the bound that came back")
    axes.legend(fontsize=8, loc="upper right", frameon=False)
    axes.set(title="What is left out or rounded", xlabel="relight, median, ms",
             ylabel="difference from the exact result, of white")


def models(axes, rows):
    for way, row in points(rows, "model").items():
        name = "sphere" if way == "half_gradient" else way
        mark(axes, 1e3 * row["value"], 100 * row["error"], LABELS[name], (7, 0))
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    axes.xaxis.set_minor_formatter(ticker.NullFormatter())
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * 3)
    axes.set_ylim(0, 1.15 * axes.get_ylim()[1])
    axes.set(title="Models of promotion", xlabel="relight, median, ms (log)",
             ylabel="RMS difference from the truth\nseen by the same mosaic, % of white")


def pictures(axes, rows):
    offsets = {"headlight": (8, 0), "sphere": (8, 0), "linear_6": (6, 9), "linear_14": (2, -12),
               "linear_26": (3, 11), "measured": (-2, 11)}
    for prefix, color, text in (("served", INK, "as served, noise and all"),
                                ("promotion", ACCENT, "promotion alone")):
        found = points(rows, prefix)
        way = [name for name in found if name != "headlight"]
        axes.plot([found[name]["value"] for name in way],
                  [100 * found[name]["error"] for name in way], "-", color=color, lw=1)
        for name, row in found.items():
            label = LABELS[name] if prefix == "served" else ""
            mark(axes, row["value"], 100 * row["error"], label, offsets[name], color=color)
        axes.plot([], [], "-o", color=color, label=text)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(270, 2700)
    axes.set_xticks([351, 416, 476, 692, 1038, 2076], ["351", "416", "476", "692", "1038", "2076"])
    axes.minorticks_off()
    axes.set_yticks([0.5, 1, 2, 3, 5], ["0.5", "1", "2", "3", "5"])
    axes.legend(fontsize=8, loc="upper right", frameon=False)
    axes.set(title="Pictures of a take", xlabel="pictures taken (log)",
             ylabel="error of the field, relative RMS, % (log)")


def draw(rows, path, subtitle):
    figure, axes = plt.subplots(2, 2, figsize=(11.5, 8.5), layout="constrained")
    for paint, at in zip((against_truth, against_exact, models, pictures), axes.flat):
        paint(at, rows)
        at.spines[["top", "right"]].set_visible(False)
        at.grid(alpha=0.2)
    figure.suptitle("Run time and pictures against error: still life, 346 lights, six spectra\n"
                    + subtitle, fontsize=11)
    figure.savefig(path)
    plt.close(figure)
