"""Figures of a bed as HTML: lifts that were tried, bone, rim, screws, milling."""

from rona_core.app.steps.implant.bed_milling import MillingView
from rona_core.app.steps.implant.implant_bed import ImplantBed, PlacedBed
from rona_core.app.steps.implant.view import percent, verdict
from rona_ui.panels.widgets import style

Rows = list[tuple[str, str]]


def verdict_note(bed: ImplantBed) -> str:
    """Return in one sentence whether the implant fits."""
    return style.note(verdict(bed), "warn" if bed.refusal is not None else "good")


def bed_table(bed: ImplantBed) -> str:
    """Return what the bed leaves of the bone; empty where it is laid nowhere."""
    placed = bed.placed
    if placed is None:
        return ""
    html = style.table(("", "n"), ("Bed", ""), _bed_rows(bed, placed))
    if placed.screws:
        rows = [
            (
                f"{number}, {one.screw.length_mm:g} mm long",
                f"{one.bone_mm:.1f} mm",
                percent(one.chance.probability),
            )
            for number, one in enumerate(placed.screws, start=1)
        ]
        html += style.table(("", "n", "n"), ("Screw", "Bone", "Holds"), rows)
    return html


def _bed_rows(bed: ImplantBed, placed: PlacedBed) -> Rows:
    rows: Rows = []
    if placed.residual_mm is not None and placed.chance is not None:
        chance = placed.chance
        rows += [
            ("Least bone below", f"{placed.residual_mm:.2f} mm"),
            (f"Probability of {bed.limit_mm:g} mm", percent(chance.probability)),
            ("… 95 % interval", f"{percent(chance.low)} to {percent(chance.high)}"),
        ]
    rows += [
        ("Rim: bone above the seat", f"≤ {placed.rim_above_mm:.2f} mm"),
        ("Rim: seat above the bone", f"≤ {placed.rim_below_mm:.2f} mm"),
        ("To unmapped bone", f"{placed.unmapped_mm:.1f} mm"),
    ]
    return rows


def lift_table(bed: ImplantBed) -> str:
    """Return the lifts that a search tried, with the probability of the best place for each."""
    if not bed.tried:
        return ""
    rows = [
        (f"{one.lift_mm:g} mm", percent(one.probability), style.verdict(_verdict(one, bed)))
        for one in bed.tried
    ]
    return style.table(("", "n", "n"), ("Lift", "Best place", ""), rows)


def _verdict(one: object, bed: ImplantBed) -> str:
    """Return pass for the lift that was taken because it is safe."""
    return "pass" if bed.refusal is None and one is bed.tried[-1] else "fail"


def milling_table(milling: MillingView) -> str:
    """Return how the bed would be milled, and how the implant lies in it."""
    minutes, seconds = divmod(round(milling.duration_s), 60)
    fit = milling.fit
    room = (
        f"{fit.gap_min_mm:.2f} mm, mean {fit.gap_mean_mm:.2f}"
        if fit.goes_in
        else f"stuck by {fit.overlap_mm:.2f} mm"
    )
    burrs = " and ".join(f"{burr.diameter_mm:g}" for burr in milling.path.burrs)
    rows = [
        ("Duration", f"{minutes} min {seconds:02d} s"),
        ("Path", f"{milling.path.length_mm() / 1000.0:.2f} m"),
        ("Layers", f"{int(milling.path.layers[-1]) + 1}"),
        ("Burr, diameter", f"{burrs} mm"),
        ("Room below the implant", room),
    ]
    return style.table(("", "n"), ("Milling", ""), rows)
