"""The figures of a session beside their limits and the paper's: what passes and what does not."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rona_core.app.declarations.declarations import Remedy
from rona_core.app.declarations.figures import FIGURES, PREDICTED, SECTIONS, Figure, Sense
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import CAPTURE, stale_reason
from rona_core.app.overview.figure_remedies import figure_remedy
from rona_core.app.steps.path.path_checks import expected_coverage
from rona_core.app.steps.roll.view import expected_duration
from rona_core.app.steps.scan.landmarks.step import verification
from rona_core.app.steps.scan.view import unwatched
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull

Verdict = Literal["pass", "review", "fail", "none"]  # none: no limit, or no value yet
REVIEW_SHARE = 0.5  # a figure that misses its limit by up to this share is for review


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedFigure:
    """One figure of a session and its verdict; one of a stale result has no value."""

    key: str
    title: str
    value: float | int | str | bool | None
    unit: str
    decimals: int
    limit: float | None
    sense: Sense
    verdict: Verdict
    paper: float | None
    section: str  # of the table of figures
    says: str  # what it means
    step: str  # that it judges
    reason: str = ""  # why it does not pass, where that is known
    stale_reason: str | None = None  # why it is left out


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityRow(JudgedFigure):
    """One figure with its verdict, and what mends it; all pages show the same words of it."""

    remedy: Remedy | None = None  # what mends it, where it does not pass

    @property
    def sentence(self) -> str:
        """Return the value in words, beside its limit."""
        if not isinstance(self.value, int | float) or isinstance(self.value, bool):
            return f"{self.title}: {self.reason or self.value}"
        words = f"{self.title} {self.value_words}"
        if self.limit is not None:
            words += f" (limit {FIGURES[self.key].words(self.limit)})"
        return f"{words}: {self.reason}" if self.reason else words

    @property
    def value_words(self) -> str:
        """Value with its unit; empty without one."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            return "" if self.value is None else str(self.value)
        missed = self.limit if self.verdict in MISSED else None
        return FIGURES[self.key].words(self.value, missed)

    @property
    def limit_words(self) -> str:
        """Limit with its sign and unit; empty without one."""
        if self.limit is None:
            return ""
        sign = "≤" if self.sense == "at most" else "≥"
        return f"{sign} {FIGURES[self.key].words(self.limit)}"

    @property
    def paper_words(self) -> str:
        """Value that the paper reports, with its unit; empty without one."""
        return "" if self.paper is None else FIGURES[self.key].words(self.paper)


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the figures of a step come to: the worst verdict, and those that do not pass."""

    verdict: Verdict
    missed: tuple[QualityRow, ...]  # the worst first

    @property
    def remedy(self) -> Remedy | None:
        """What mends the worst of them that a message mends, else the worst that words do."""
        known = [row.remedy for row in self.missed if row.remedy is not None]
        return next((one for one in known if one.message is not None), known[0] if known else None)


@dataclass(frozen=True, slots=True)
class QualitySection:
    """Figures that belong together, each with the prediction of it where there is one."""

    title: str
    rows: tuple[tuple[QualityRow, QualityRow | None], ...]
    left_out: tuple[QualityRow, ...]  # of stale results


@dataclass(frozen=True, slots=True)
class QualityTable:
    """All figures that have a value: predictions first, then sections versus ground truth."""

    predicted: tuple[QualityRow, ...]
    sections: tuple[QualitySection, ...]  # those that are not empty


ELSEWHERE = ("Outer boundary by cause", "Thickness by cause", "The run as a whole")
OWN_WORD: dict[str, Verdict] = {"good": "pass", "weak": "review", "bad": "fail"}
MISSED = ("fail", "review")
WORST_FIRST: tuple[Verdict, ...] = ("fail", "review", "pass", "none")
CONTRADICTED = "the caliper contradicts the echoes, so the inner map may be of another boundary"
VOXELS = (
    "the skull comes from voxels: where its surface runs along them their terraces remain, and "
    "its normals are off by several degrees"
)


def quality_rows(
    figures: Mapping[str, Any], session: Session | None = None
) -> tuple[QualityRow, ...]:
    """Return a row for every figure, in the order of the procedure.

    The step list, the notes of the panels and the table of figures all speak from these rows.

    Args:
        figures: Values by key; a key that is missing or None has no value yet.
        session: Whose smoothing tolerance limits the path deviation, whose calibrations have a say
            of their own, and whose stale results have no figures: they would be compared with the
            truth of another set-up.
    """
    if session is not None:
        figures = {**figures, **_known_at_once(session)}
    return tuple(
        _row(figure, section, figures, session)
        for section, part in SECTIONS.items()
        for figure in part
    )


def _known_at_once(session: Session) -> dict[str, float]:
    """Return figures of the session without the truth, which takes seconds to compute."""
    results, known = session.results, dict[str, float]()
    if results.tool is not None:
        known["tool_tip_sigma_mm"] = results.tool.value.tip_sigma_mm
        known["tracker_registration_sigma_mm"] = results.tool.value.registration_sigma_mm
    if results.pointer is not None:
        known["pointer_tip_sigma_mm"] = results.pointer.value.tip_sigma_mm
    if (burr := results.get("burr")) is not None:
        known["burr_tip_sigma_mm"] = burr.value.tip_sigma_mm
    if (share := expected_coverage(session)) is not None:
        known["coverage_predicted_fraction"] = share
    if (duration_s := expected_duration(session)) is not None:
        known["scan_duration_predicted_s"] = duration_s
    if results.smoothing is not None:
        known["path_deviation_max_mm"] = float(results.smoothing.value.from_filtered_mm.max())
    return known


def _row(
    figure: Figure, section: str, figures: Mapping[str, Any], session: Session | None
) -> QualityRow:
    key, value = figure.key, figures.get(figure.key)
    limit, stale, reason = figure.limit, None, ""
    if key == "path_deviation_max_mm" and session is not None:
        limit = _tolerance_mm(session, limit)
    if key == "rolls_feasible" and figures.get("roll_mode") == "variable":
        limit = None  # a roll that varies does what no constant one may be able to
    if session is not None and figure.of and value is not None:
        stale = stale_reason(figure.of, session)
    value = None if stale else value
    judged = verdict(value, limit, figure.sense)
    if session is not None and value is not None:
        judged, reason = _with_own_word(figure, judged, session)
    if session is not None and key == "head_motion_mm" and (why := unwatched(session)) is not None:
        judged, reason = "review", why
    return QualityRow(
        key=key,
        title=figure.title,
        value=value,
        unit=figure.unit,
        decimals=figure.decimals,
        limit=limit,
        sense=figure.sense,
        verdict=judged,
        paper=figure.paper,
        section=section,
        says=figure.says,
        step=_step_of(figure.of),
        reason=reason,
        stale_reason=stale,
        remedy=None if session is None or judged not in MISSED else figure_remedy(key, session),
    )


def _step_of(part: str) -> str:
    """Return the step of the procedure that lists a result or capture; nothing is of the maps."""
    name = part.removeprefix(CAPTURE)
    listed = (step for step in REGISTRY.step_names if name in sum(REGISTRY.parts_of(step), ()))
    return next(listed, "maps")


def _with_own_word(figure: Figure, judged: Verdict, session: Session) -> tuple[Verdict, str]:
    """Return the verdict with what the session itself says of the figure, and why."""
    key = figure.key
    if figure.own_verdict:
        held = session.results.get(figure.of)
        if held is not None and OWN_WORD[held.value.verdict] != "pass":
            return worst((judged, OWN_WORD[held.value.verdict])), "; ".join(held.value.reasons)
    if key in ("landmark_distance_mm", "tracker_registration_sigma_mm"):
        found = verification(session)
        if found.state in ("failed", "overridden") and key == "landmark_distance_mm":
            return "fail", found.sentence.rstrip(".")
        if found.state == "passed" and found.check is not None and found.check.contradiction:
            return worst((judged, "review")), found.check.contradiction
    speed = session.results.speed
    if key == "thickness_sigma_predicted_mm" and speed is not None:
        if speed.value.verdict == "bad" and stale_reason("speed", session) is None:
            return "fail", f"{CONTRADICTED}: {'; '.join(speed.value.reasons)}"
    if key == "inner_coverage_fraction" and judged in ("review", "fail"):
        return judged, judge_part("maps", session).reason
    specimen = session.setup.specimen
    voxels = isinstance(specimen, LoadedSkull) and specimen.kind in ("mask", "ct")
    if key.startswith("normal_error") and voxels and judged in ("review", "fail"):
        return judged, VOXELS
    return judged, ""


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of some verdicts; "none" where there are none."""
    found = set(verdicts)
    for one in WORST_FIRST:
        if one in found:
            return one
    return "none"


def judgement(rows: Iterable[QualityRow], step: str) -> Judgement:
    """Return what the figures of a step come to."""
    own = [row for row in rows if row.step == step]
    missed = [row for row in own if row.verdict in MISSED]
    missed.sort(key=lambda row: WORST_FIRST.index(row.verdict))
    return Judgement(worst(row.verdict for row in own), tuple(missed))


def verdict(value: object, limit: float | None, sense: Sense) -> Verdict:
    """Return whether a value keeps its limit, nearly does, or does not."""
    if limit is None or not isinstance(value, int | float) or isinstance(value, bool):
        return "none"
    if sense == "at most":
        near, within = limit * (1.0 + REVIEW_SHARE), abs(value) <= limit * (1.0 + 1e-9)
        return "pass" if within else "review" if abs(value) <= near else "fail"
    near = limit * (1.0 - REVIEW_SHARE)
    return "pass" if value >= limit else "review" if value >= near else "fail"


def _tolerance_mm(session: Session, otherwise: float | None) -> float | None:
    """Return the bound of K1; None where the path was smoothed within a bound of another kind."""
    smoothing = session.results.smoothing
    if smoothing is None:
        return otherwise
    tolerance = smoothing.arguments.get("tolerance_mm")
    if smoothing.arguments.get("metric", "k1") != "k1":
        return None
    return float(tolerance) if isinstance(tolerance, int | float) else otherwise


def quality_table(rows: Iterable[QualityRow]) -> QualityTable:
    """Return figures by section; those without a value are left out.

    Causes of errors stand beside their predictions in the error budget of step 9, and what ended a
    run in its last line.
    """
    rows = tuple(row for row in rows if row.section not in ELSEWHERE)
    present = [row for row in rows if row.value is not None]
    expected = {row.key: row for row in present if row.key in PREDICTED}
    sections: list[QualitySection] = []
    for title in SECTIONS:
        part = tuple(
            (row, expected.get(FIGURES[row.key].truth_of))
            for row in present
            if row.section == title and row.key not in expected
        )
        left_out = tuple(row for row in rows if row.stale_reason and row.section == title)
        if part or left_out:
            sections.append(QualitySection(title, part, left_out))
    return QualityTable(tuple(expected.values()), tuple(sections))


def pending_figures(session: Session, judged: Session | None) -> frozenset[str]:
    """Return the keys of figures of ``session`` that are still to be computed.

    They are those of results and captures that ``judged`` does not hold.

    Args:
        session: The present session.
        judged: The session that the present figures belong to, None where there are none.
    """
    if judged is session:
        return frozenset()
    return frozenset(
        figure.key
        for figure in FIGURES.values()
        if figure.of
        and (part := _part(figure.of, session)) is not None
        and (judged is None or part is not _part(figure.of, judged))
        and stale_reason(figure.of, session) is None
    )


def _part(name: str, session: Session) -> object:
    """Return a result (``"roll"``) or capture (``"capture scan"``) of a session, or None."""
    held = session.captures if name.startswith(CAPTURE) else session.results
    return held.get(name.removeprefix(CAPTURE))
