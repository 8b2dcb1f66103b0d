"""What a reader sees of a figure: texts and legends, and whether they cover each other."""

from itertools import combinations

import matplotlib.pyplot as plt

SLACK = 1.0
"""Pixels by which two boxes may overlap: boxes of texts have margins."""


def boxes(figure):
    """Return the box of every text and legend that is drawn, pixels, with its text."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    parts = [(text.get_text(), text) for text in figure.texts]
    parts += [(text_of(legend), legend) for legend in figure.legends]
    for ax in figure.axes:
        if ax.get_visible():
            parts += list(of_axes(ax))
    return [
        (name, part.get_window_extent(renderer))
        for name, part in parts
        if part.get_visible() and name.strip() and getattr(part, "get_alpha", float)() != 0
    ]


def text_of(legend):
    return "legend: " + ", ".join(text.get_text() for text in legend.get_texts())


def of_axes(ax):
    """Yield the texts of one panel, and its legend as one."""
    if legend := ax.get_legend():
        yield text_of(legend), legend
    for text in (*ax.texts, ax.title, ax._left_title, ax._right_title):
        yield text.get_text(), text
    for axis in (ax.xaxis, ax.yaxis) if ax.axison else ():
        yield axis.label.get_text(), axis.label
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            label = tick.label1 if tick.label1.get_visible() else tick.label2
            if low <= tick.get_loc() <= high:
                yield label.get_text(), label


def covered(figure):
    """Return pairs of texts of which one covers the other, and texts that are cut off."""
    try:
        every = boxes(figure)
        edge = figure.bbox
    finally:
        plt.close(figure)
    overlaps = [
        (name, "the edge")
        for name, box in every
        if box.x0 < edge.x0 - SLACK or box.x1 > edge.x1 + SLACK
        or box.y0 < edge.y0 - SLACK or box.y1 > edge.y1 + SLACK
    ]  # fmt: skip
    for (one, a), (other, b) in combinations(every, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        if wide > SLACK and high > SLACK and not ("legend" in one and other in one):
            overlaps.append((one, other))
    return overlaps


def under_legends(figure):
    """Return panel and label of each line with a data point under the legend of its panel."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    hidden = []
    for ax in figure.axes:
        if legend := ax.get_legend():
            box = legend.get_window_extent(renderer).padded(-3)
            for line in ax.lines:
                points = line.get_transform().transform(line.get_xydata())
                level = len(points) == 2 and (points[0] == points[1]).any()  # a reference line
                if line.get_visible() and not level and any(box.contains(*p) for p in points):
                    hidden.append((ax.get_title("left"), line.get_label()))
    return hidden
