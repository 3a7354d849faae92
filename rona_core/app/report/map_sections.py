"""Sections of the report about what step 9 made: maps, and how sure they are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.report.map_pictures import map_picture
from rona_core.app.report.page import Html, joined, note, table, tag, tile
from rona_core.app.report.thickness_graphs import section_graph, thickness_histogram
from rona_core.app.steps.acoustics.view import loss_words, speed_words
from rona_core.app.steps.boundaries.probe_advice import probe_advice
from rona_core.app.steps.maps.accuracy import map_accuracy
from rona_core.app.steps.maps.error_budget import error_budgets
from rona_core.app.steps.maps.export import map_sheet
from rona_core.app.steps.maps.view import ROUND_MM, ROUND_SIGMA_MM, scale_limits_mm
from rona_core.geometry.arrays import Floats
from rona_core.mapping.accuracy.map_accuracy import accuracy_words
from rona_core.mapping.files.map_sheet import MapSheet, cell_sizes_mm
from rona_core.session.document import Session

MM2_PER_CM2 = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class MapFacts:
    """What the maps come to in a few figures; ``thickness_mm`` are those of the cells (n,)."""

    sheet: MapSheet
    thickness_mm: Floats
    thickness_sigma_mm: float | None  # RMS; None where it is not known
    outer_cm2: float
    inner_share: float  # of the outer map


def map_facts(session: Session) -> MapFacts | None:
    """Return the figures of the robot's maps; None where there are none, or stale ones."""
    if session.results.maps is None or stale_reason("maps", session) is not None:
        return None
    sheet = map_sheet(session)
    ok, outer_ok = sheet.thickness_ok(), sheet.maps.outer.ok
    sigma = sheet.sigma_mm("thickness")["total"]
    known = sigma[np.isfinite(sigma)]
    du, dv = cell_sizes_mm(sheet.maps.outer)
    return MapFacts(
        sheet=sheet,
        thickness_mm=sheet.thickness_mm()[ok],
        thickness_sigma_mm=float(np.sqrt(np.mean(known**2))) if known.size else None,
        outer_cm2=float(outer_ok.sum()) * du * dv / MM2_PER_CM2,
        inner_share=float(ok.sum()) / max(int(outer_ok.sum()), 1),
    )


def map_tiles(session: Session, found: MapFacts | None) -> tuple[Html, ...]:
    """Return thickness and area in large letters."""
    if found is None:
        why = "no map" if session.results.maps is None else "stale, left out"
        return (tile("Bone thickness", "–", why), tile("Mapped area", "–", why))
    thick = tile("Bone thickness, median", "–", "no inner boundary")
    if len(found.thickness_mm):
        low, middle, high = np.percentile(found.thickness_mm, (10.0, 50.0, 90.0))
        sigma = found.thickness_sigma_mm
        words = f"10 to 90 %: {low:.1f} to {high:.1f} mm"
        words += "" if sigma is None else f"; expected error {sigma:.2f} mm (1 σ)"
        thick = tile("Bone thickness, median", f"{middle:.1f} mm", words)
    share = f"inner boundary in {100.0 * found.inner_share:.0f} % of it"
    return (thick, tile("Mapped area", f"{found.outer_cm2:.1f} cm²", share))


def maps_section(session: Session, found: MapFacts | None) -> Html:
    """Return the maps as pictures, a section and the thickness."""
    title = tag("h2", "Maps")
    if found is None:
        return joined((title, _why_none(session)))
    sheet = found.sheet
    outer = sheet.boundary("outer")
    heights = np.where(outer.ok, outer.height_mm, np.nan)
    pictures = (
        ("Bone thickness", sheet.thickness_mm(), ROUND_MM, 1),
        ("Outer boundary, height", heights, ROUND_MM, 1),
        ("Expected thickness error, 1 σ", sheet.sigma_mm("thickness")["total"], ROUND_SIGMA_MM, 2),
    )
    drawn = tag(
        "div",
        *(_picture(title, sheet, values, step, digits) for title, values, step, digits in pictures),
        css="maps",
    )
    graphs: list[Html] = []
    if len(found.thickness_mm):
        words = "Outer and inner boundary with ± 2 σ; bone between them."
        graphs.append(tag("figure", section_graph(sheet), tag("figcaption", words)))
        words = f"{len(found.thickness_mm)} cells with both boundaries."
        histogram = thickness_histogram(found.thickness_mm)
        graphs.append(tag("figure", histogram, tag("figcaption", words)))
    frame = "Frame of the map: u to the right, v upwards, z out of the bone; blank: not mapped."
    return joined((title, drawn, tag("p", frame, css="soft"), tag("div", *graphs, css="two")))


def _picture(title: str, sheet: MapSheet, values: Floats, step: float, digits: int) -> Html:
    known = values[np.isfinite(values)]
    if not known.size:
        return tag("figure", note(f"{title}: not known."))
    limits = scale_limits_mm(known, step)
    words = f"{known.min():.{digits}f} to {known.max():.{digits}f} mm, mean {known.mean():.2f} mm."
    drawn = map_picture(f"{title} (mm)", sheet.boundary("outer"), values, limits, digits)
    return tag("figure", drawn, tag("figcaption", words))


def _why_none(session: Session) -> Html:
    reason = None if session.results.maps is None else stale_reason("maps", session)
    by_hand = session.results.sono_maps is not None
    words = "Not mapped yet (step 9)." if reason is None else f"Stale, left out: {reason}."
    if by_hand:
        words += " Maps of the scan by hand are not part of the report."
    return note(words, "warn")


def accuracy_section(
    session: Session, found: MapFacts | None, figures: Mapping[str, Any], with_truth: bool
) -> Html:
    """Return what the maps are expected to err by, and by what."""
    accuracy = None if found is None else map_accuracy(session)
    if found is None or accuracy is None:
        return Html("")
    detection, speed = session.results.detection, speed_words(session)
    lines = [accuracy_words(found.sheet.maps, accuracy)]
    lines += ["Speed of sound: " + (speed or "published mean.")]
    lines += [] if detection is None else [loss_words(detection.value)]
    advice = probe_advice(session)
    lines += [] if advice is None else [advice.sentence]
    budgets: list[Html] = []
    for budget in error_budgets(accuracy, figures):
        rows = [
            [line.title, f"{line.predicted_mm:.3f}"] + ([_mm(line.true_mm)] if with_truth else [])
            for line in budget.lines
        ]
        head = [budget.name, "σ (mm)", *(["true, RMS"] if with_truth else [])]
        words = f"Largest: {budget.largest}." if budget.largest else ""
        words += f" To lower it: {budget.remedy}." if budget.remedy else ""
        drawn = table(head, rows, ("", "n", "n")[: len(head)])
        budgets.append(tag("div", drawn, tag("p", words, css="soft")))
    return joined(
        (
            tag("h2", "Accuracy of the maps"),
            *(tag("p", line) for line in lines if line),
            tag("h3", "Error budget"),
            tag("div", *budgets, css="halves"),
        )
    )


def _mm(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
