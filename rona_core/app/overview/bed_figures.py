"""Figures of an implant bed and its milling as rows of words: panel and report show them."""

from rona_core.app.declarations.figures import FIGURES, percent
from rona_core.app.steps.implant.derivation import ImplantBed, PlacedBed
from rona_core.app.steps.implant.milling import MillingView

RESIDUAL = FIGURES["bed_residual_mm"]
Rows = list[tuple[str, str]]
SCREW_HEAD = ("Screw", "Length", "Bone", "Holds")
LIFT_HEAD = ("Lift", "Best place", "")


def bed_rows(bed: ImplantBed, placed: PlacedBed) -> Rows:
    """Return what the bed leaves of the bone."""
    rows: Rows = []
    if placed.residual_mm is not None and placed.chance is not None:
        chance = placed.chance
        rows += [
            (RESIDUAL.title, RESIDUAL.words(placed.residual_mm)),
            (f"Probability of {bed.limit_mm:g} mm", percent(chance.probability)),
            ("… 95 % interval", f"{percent(chance.low)} to {percent(chance.high)}"),
        ]
    rows += [
        ("Rim: bone above the seat", f"≤ {placed.rim_above_mm:.2f} mm"),
        ("Rim: seat above the bone", f"≤ {placed.rim_below_mm:.2f} mm"),
        ("To unmapped bone", f"{placed.unmapped_mm:.1f} mm"),
    ]
    return rows


def screw_rows(placed: PlacedBed) -> list[tuple[str, str, str, str]]:
    """Return for each screw the cells below ``SCREW_HEAD``."""
    return [
        (
            str(number),
            f"{one.screw.length_mm:g} mm",
            f"{one.bone_mm:.1f} mm",
            percent(one.chance.probability),
        )
        for number, one in enumerate(placed.screws, start=1)
    ]


def lift_rows(bed: ImplantBed) -> list[tuple[str, str, str]]:
    """Return the lifts that a search tried, the probability of the best place, and the verdict.

    The last lift passes if it was taken because it is safe.
    """
    safe = None if bed.refusal is not None or not bed.tried else bed.tried[-1]
    return [
        (f"{one.lift_mm:g} mm", percent(one.probability), "pass" if one is safe else "fail")
        for one in bed.tried
    ]


def milling_rows(milling: MillingView) -> Rows:
    """Return how the bed would be milled, and how the implant lies in it."""
    minutes, seconds = divmod(round(milling.duration_s), 60)
    fit = milling.fit
    room = (
        f"{fit.gap_min_mm:.2f} mm, mean {fit.gap_mean_mm:.2f}"
        if fit.goes_in
        else f"stuck by {fit.overlap_mm:.2f} mm"
    )
    burrs = " and ".join(f"{burr.diameter_mm:g}" for burr in milling.path.burrs)
    return [
        ("Milling alone, at its feeds", f"{minutes} min {seconds:02d} s"),
        ("Path", f"{milling.path.length_mm() / 1000.0:.2f} m"),
        ("Layers", f"{int(milling.path.layers[-1]) + 1}"),
        ("Burr, diameter", f"{burrs} mm"),
        ("Room below the implant", room),
    ]
