"""Report of a session: one page to print and to keep, which needs no program and no network.

The same session gives the same bytes: what stands in it is in the session, and no clock is asked.
What is missing or stale is left out, and the page says so in its place.
"""

from collections.abc import Mapping
from typing import Any

from rona_core import __version__
from rona_core.app.dependencies.judge import State, StepState, step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.acceptance import QualityRow, quality_rows
from rona_core.app.report.map_sections import (
    accuracy_section,
    map_facts,
    map_tiles,
    maps_section,
)
from rona_core.app.report.page import Html, facts, joined, note, table, tag, tile, whole_page
from rona_core.app.report.sections import (
    bed_section,
    calibration_section,
    certified,
    motion_section,
    procedure_section,
    quality_section,
)
from rona_core.app.runtime.workbench import Workbench
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.members import SCHEMA
from rona_core.session.specimen import LoadedSkull

VIRTUAL = "VIRTUAL"
WARNINGS: tuple[tuple[str, tuple[State, ...]], ...] = (
    ("Not done", ("ready", "blocked")),
    ("Stopped early", ("partial",)),
    ("Stale, and left out", ("stale",)),
)
NOT_MEDICAL = "Research software, not a medical device."


def workbench_report(bench: Workbench) -> str:
    """Return the report of an open session, with its figures as they are now."""
    session = bench.session
    return session_report(session, bench.figures(), bench.rig().origin)


def session_report(session: Session, figures: Mapping[str, Any], origin: str | None) -> str:
    """Return the report as one HTML page without scripts.

    Args:
        session: That it is of.
        figures: Of the session by the keys of ``docs/metrics.md``; those against ground truth only
            where the devices are virtual.
        origin: Of the devices: VIRTUAL, REPLAY or REAL; None where that is not known.
    """
    rows, states = quality_rows(figures, session), step_states(session)
    found, with_truth = map_facts(session), origin == VIRTUAL
    warnings = [note(words, "warn") for words in _warnings(states)]
    return whole_page(
        f"{session.name}: scan report",
        _head(session, origin, not warnings),
        tag(
            "div",
            *map_tiles(session, found),
            _figure_tile(rows),
            _motion_tile(session),
            css="tiles",
        ),
        *warnings,
        maps_section(session, found),
        accuracy_section(session, found, figures, with_truth),
        bed_section(session),
        procedure_section(states, rows),
        quality_section(rows, with_truth),
        calibration_section(session, rows),
        motion_section(session),
        _provenance(session),
        tag("footer", f"RONA {__version__}. {NOT_MEDICAL}"),
    )


def _warnings(states: tuple[StepState, ...]) -> list[str]:
    """Return a sentence about the steps that are not done, stopped early, or stale."""
    lines: list[str] = []
    for words, kinds in WARNINGS:
        steps = [f"{step.number} {step.title}" for step in states if step.state in kinds]
        lines += [f"{words}: {', '.join(steps)}."] if steps else []
    return lines


def _head(session: Session, origin: str | None, complete: bool) -> Html:
    """Return title, date and what was scanned with what."""
    setup = session.setup
    specimen = "skull from a file" if isinstance(setup.specimen, LoadedSkull) else "simulated skull"
    kind = "" if origin is None else f"{origin.lower()} devices"
    if origin == VIRTUAL:
        kind += f", {setup.world.profile} world"
    pairs = (
        ("Begun", _utc(session.created_utc)),
        ("Last change", _utc(session.log[-1].time_utc) if session.log else "none"),
        ("Specimen", specimen),
        ("Seed", setup.seed),
        ("Region", f"radius {setup.region.radius_mm:g} mm"),
        *setup.devices.titles().items(),
        ("Devices", kind or "not known"),
        ("Status", "complete" if complete else "not complete, see below"),
    )
    return tag(
        "header",
        tag("div", "RONA scan report", css="kind"),
        tag("h1", session.name),
        facts(pairs),
    )


def _utc(time: str) -> str:
    """Return a time of the session as people read it."""
    day, _, rest = time.partition("T")
    return f"{day} {rest[:5]} UTC".replace("  ", " ")


def _figure_tile(rows: tuple[QualityRow, ...]) -> Html:
    """Return how many figures keep their limits."""
    counts = {kind: sum(row.verdict == kind for row in rows) for kind in ("pass", "review", "fail")}
    total = sum(counts.values())
    stale = sum(row.stale_reason is not None for row in rows)
    words = f"{counts['review']} for review, {counts['fail']} failed"
    words += f", {stale} stale and left out" if stale else ""
    value = f"{counts['pass']} of {total}" if total else "–"
    return tile("Figures within limits", value, words if total else "no figures yet")


def _motion_tile(session: Session) -> Html:
    """Return whether the motion is certified."""
    found = certified(session)
    if found is None:
        words = "stale" if session.results.roll is not None else "no motion planned"
        return tile("Robot motion", "–", words)
    held = f"{len(found.rows) - len(found.failures)} of {len(found.rows)} checks hold"
    return tile("Robot motion", "certified" if found.certified else "refused", held)


def _provenance(session: Session) -> Html:
    """Return what the page was made of, so that anybody can hold it against the session file."""
    results = session.results
    made = [
        ("Maps", results.maps, "maps"),
        ("Detection", results.detection, "detection"),
        ("Registration", results.tool, "tool"),
    ]
    digests = [
        ("Set-up", digest(session.setup)),
        ("Captures", digest(session.captures)),
        *(
            (name, digest(derived.value))
            for name, derived, key in made
            if derived is not None and stale_reason(key, session) is None
        ),
    ]
    pairs: list[tuple[str, object]] = [
        ("Program", f"RONA {__version__}"),
        ("File format", f"schema {SCHEMA}"),
        ("Session", session.id),
        ("Revision", f"{len(session.log)} messages"),
        ("Recordings", len(session.archive)),
    ]
    shown = table(("Part", "SHA-256"), [(name, tag("code", value)) for name, value in digests])
    return joined((tag("h2", "Provenance"), facts(pairs), shown))
