"""What does an answer look like in a notebook?

The image with what was found, missing and unexpected, and the posterior as bars. SVG over a JPEG, in one
piece: nothing is fetched from anywhere.
"""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ._chronotope import Localization, PredictedMap

FOUND, MISSING, UNEXPECTED = "#16a34a", "#ea580c", "#94a3b8"
#: More bars than this are left out; the last one says how many.
_MOST_BARS = 8
_WIDTH_PX = 440


def _circle(x: float, y: float, radius: float, colour: str, width: float) -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="{colour}" '
        f'stroke-width="{width:.1f}"/>'
    )


def _picture(answer: Localization) -> str:
    features = answer.features
    size = features.image_size
    if size is None:
        return ""
    width, height = size
    unit = width / 224.0
    parts: list[str] = []
    jpeg = answer._jpeg()
    if jpeg is not None:
        data = base64.b64encode(jpeg).decode()
        parts.append(
            f'<image href="data:image/jpeg;base64,{data}" width="{width}" height="{height}" '
            'preserveAspectRatio="none"/>'
        )
    else:
        parts.append(f'<rect width="{width}" height="{height}" fill="#1e293b"/>')
    xy = features.xy
    for row in answer.unexpected:
        x, y = xy[row]
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{unit:.1f}" fill="{UNEXPECTED}"/>')
    for x, y in answer.missing_xy:
        parts.append(_circle(x, y, 3 * unit, MISSING, 0.8 * unit))
    matches = answer.matches
    for match in matches[matches["inlier"]]:
        parts.append(_circle(match["live_x"], match["live_y"], 3 * unit, FOUND, unit))
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{_WIDTH_PX}" style="max-width:100%;height:auto;'
        f'border-radius:4px">{"".join(parts)}</svg>'
    )


def _legend(answer: Localization) -> str:
    matches = answer.matches
    counts = [
        (FOUND, "found", int(np.count_nonzero(matches["inlier"]))),
        (MISSING, "missing", len(answer.missing_xy)),
        (UNEXPECTED, "unexpected", len(answer.unexpected)),
    ]
    return "".join(
        f'<span style="margin-right:1em"><span style="color:{colour}">●</span> {number} {name}</span>'
        for colour, name, number in counts
    )


def _bar(name: str, share: float, colour: str) -> str:
    return (
        '<tr><td style="text-align:right;padding:1px 8px;white-space:nowrap">'
        f"{escape(name)}</td>"
        '<td style="width:160px;padding:1px 0"><div style="background:rgba(128,128,128,.18)">'
        f'<div style="background:{colour};width:{100 * share:.1f}%;height:0.9em"></div></div></td>'
        f'<td style="padding:1px 8px;text-align:right">{100 * share:.1f} %</td></tr>'
    )


def _bars(answer: Localization) -> str:
    ranking = answer.ranking
    shown = sorted(ranking, key=lambda it: -it.posterior)[:_MOST_BARS]
    chosen = set(answer.region)
    rows = [
        _bar(it.place, it.posterior, FOUND if it.place in chosen else "#2563eb") for it in shown
    ]
    left = len(ranking) - len(shown)
    if left > 0:
        rest = sum(it.posterior for it in ranking) - sum(it.posterior for it in shown)
        rows.append(_bar(f"{left} more places", max(rest, 0.0), "#2563eb"))
    rows.append(_bar("off the map", answer.off_map, UNEXPECTED))
    return f'<table style="border-collapse:collapse;font-size:90%">{"".join(rows)}</table>'


def localization(answer: Localization) -> str:
    """An answer as HTML."""
    verdict = {
        "at": f"at <b>{escape(answer.place or '')}</b>",
        "near": "at one of <b>" + escape(", ".join(answer.region)) + "</b>",
        "ambiguous": "in the map, but several places fit",
        "unknown": "unknown",
    }[answer.decision]
    when = answer.time
    title = " · ".join(
        part
        for part in (
            verdict,
            escape(answer.name),
            f"{when:%Y-%m-%d %H:%M} UTC" if when is not None else "",
        )
        if part
    )
    return (
        '<div style="font-family:sans-serif;line-height:1.5">'
        f"<div>{title}</div>"
        '<div style="display:flex;gap:1.5em;flex-wrap:wrap;align-items:flex-start">'
        f"<div>{_picture(answer)}<div>{_legend(answer)}</div></div>"
        f'<div>{_bars(answer)}<div style="max-width:20em;opacity:.75">{escape(answer.reason)}</div>'
        "</div></div></div>"
    )


def predicted_map(predicted: PredictedMap) -> str:
    """A predicted map as HTML: the more likely a feature, the greener and larger it is."""
    xy, p = predicted.xy, predicted.p
    if len(xy) == 0:
        return escape(repr(predicted))
    width, height = (float(side) for side in xy.max(axis=0) + 20)
    unit = width / 224.0
    circles = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{unit * (1 + 2 * share):.1f}" fill="{FOUND}" '
        f'fill-opacity="{0.15 + 0.85 * share:.2f}"/>'
        for (x, y), share in zip(xy, p)
    )
    return (
        '<div style="font-family:sans-serif">'
        f"<div><b>{escape(predicted.place)}</b> at {predicted.time:%Y-%m-%d %H:%M} UTC: "
        f"{len(xy)} features, p {p.min():.2f} to {p.max():.2f}</div>"
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{_WIDTH_PX}" style="max-width:100%;'
        f'height:auto;background:rgba(128,128,128,.12)">{circles}</svg></div>'
    )
