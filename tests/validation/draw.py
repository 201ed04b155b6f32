"""Draws the results of pia.py: panels as JSON on stdin, FILE.png and FILE.svg.

    draw.py FILE < panels.json        pia.py describes them
"""

import json
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "dimple", "axes.grid": True, "grid.color": "#e4e7eb", "axes.axisbelow": True})
HUES = ["#0072b2", "#d55e00", "#009e73", "#b5588f", "#d99100", "#4aa3d9", "#3a4654", "#7a1f4b"]


def draw(axes, panel):
    free = (k for k in range(1000) if k not in {series["colour"] for series in panel["series"]})
    for series in panel["series"]:
        number = series["colour"] if series["colour"] >= 0 else next(free)
        hue = HUES[number % len(HUES)]
        axes.plot(
            series["x"],
            series["y"],
            color=hue,
            linestyle=("--" if series["dashed"] else "-") if series["line"] else "",
            marker="osD^v"[number // len(HUES) % 5] if series["markers"] else "",
            markersize=4,
            markerfacecolor="white" if series["hollow"] else hue,
            label=series["name"] or None,
        )
        for x, y, text in zip(series["x"], series["y"], series["label"]):
            axes.annotate(text, (x, y), (4, 4), textcoords="offset points", fontsize=7)
    for line in panel["lines"]:
        (axes.axvline if line["vertical"] else axes.axhline)(line["at"], color="#5a6068", linestyle="--", linewidth=0.9)
        at, way = ((line["at"], 0.02), ("data", "axes fraction")) if line["vertical"] else ((0.01, line["at"]), ("axes fraction", "data"))
        axes.annotate(line["text"], at, xycoords=way, fontsize=7, rotation=90 if line["vertical"] else 0, va="bottom")
    axes.set(xlabel=panel["x_label"], ylabel=panel["y_label"])
    axes.set(xscale="log" if panel["log_x"] else "linear", yscale="log" if panel["log_y"] else "linear")
    axes.set(xlim=panel.get("x_range"), ylim=panel.get("y_range"))
    axes.set_title("\n".join([panel["title"], *panel["subtitle"]]), fontsize=8, loc="left")
    axes.legend(fontsize=6, frameon=False)


def main(file):
    picture = json.load(sys.stdin)
    panels, columns = picture["panels"], min(picture["columns"], len(picture["panels"]))
    rows = -(-len(panels) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(9 * columns, 5.9 * rows), squeeze=False, constrained_layout=True)
    for one, panel in zip(axes.flat, panels):
        draw(one, panel)
    figure.savefig(file + ".png", dpi=110, metadata={"Software": None})
    figure.savefig(file + ".svg", metadata={"Date": None})


if __name__ == "__main__":
    main(sys.argv[1])
