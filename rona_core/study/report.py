"""Report of a study: one page of distributions, which needs no program and no network.

The same rows give the same bytes: no clock is asked, and what is drawn again has a seed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.figures import SECTIONS, Figure
from rona_core.app.report.page import (
    Html,
    facts,
    joined,
    markup,
    note,
    table,
    tag,
    tile,
    whole_page,
)
from rona_core.geometry.arrays import Floats
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import Row
from rona_core.study.plan import KeepRule, Plan, Range
from rona_core.study.statistics import (
    CONFIDENCE,
    FEWEST,
    Calibration,
    Estimate,
    Share,
    beyond_limit,
    calibrations,
    effects,
    quantile,
    shares,
    values,
    worst,
)
from rona_core.study.study import failures_of

MOST_EFFECTS = 30
STRIP, STRIP_HEIGHT = 150.0, 16.0  # px of the small drawing of a distribution
CURVE, CURVE_HEIGHT, CURVE_LEFT, CURVE_TOP, CURVE_BELOW = 290.0, 120.0, 34.0, 24.0, 20.0
MOST_SIGMAS = 3  # of the axis of a calibration curve
EVERY = f"In brackets the interval of {CONFIDENCE:.0%}."


def study_report(folder: StudyFolder) -> str:
    """Return the report of a study as one HTML page without scripts.

    Raises:
        NotFoundError: no study was run there.
    """
    plan = folder.plan()
    total, rows = len(plan.patients()), list(folder.rows(plan).values())
    found = shares(plan, rows)
    return whole_page(
        f"{plan.title}: study",
        _head(plan, rows, total),
        tag("div", *(_share_tile(share) for share in found[:4]), css="tiles"),
        note(_unfinished(total - len(rows)), "warn"),
        _shares_section(found),
        _failures_section(rows),
        _figures_section(rows),
        _effects_section(plan, rows),
        _calibration_section(rows),
        *(_chosen_section(rule, plan, rows, folder) for rule in plan.keep),
        tag("footer", "RONA. Research software, not a medical device. Virtual patients only."),
    )


def _unfinished(left: int) -> str:
    return f"Not finished: {left} patients have no row yet." if left else ""


def _head(plan: Plan, rows: Sequence[Row], total: int) -> Html:
    seeds = plan.seeds
    pairs: list[tuple[str, object]] = [
        ("Patients", f"{len(rows)} of {total}"),
        ("Seeds", f"{seeds.start} to {seeds.stop - 1}"),
        ("Design", plan.design),
        ("Last stage", plan.until),
        ("Version", ", ".join(sorted({str(row["version"]) for row in rows})) or "–"),
        ("Left out", ", ".join(plan.skip) or "nothing"),
    ]
    factors = [(name, _levels(of)) for name, of in plan.factors.items()]
    return tag(
        "header",
        tag("div", "RONA study", css="kind"),
        tag("h1", plan.title),
        facts(pairs),
        table(("Factor", "Levels"), factors, ("name",)) if factors else "",
    )


def _levels(of: Range | Sequence[object]) -> str:
    return f"{of.low:g} to {of.high:g}" if isinstance(of, Range) else ", ".join(map(str, of))


def _share_tile(share: Share) -> Html:
    found = share.estimate
    words = f"{share.count} of {share.of}; {bounds(found, percent)}"
    return tile(share.title, percent(found.value), words)


def percent(value: float) -> str:
    """Return a share in percent."""
    return f"{100.0 * value:.1f} %"


def bounds(found: Estimate, words: Callable[[float], str]) -> str:
    """Return an interval in brackets; a dash for a bound that the patients are too few for."""
    said = ["–" if bound is None else words(bound) for bound in (found.low, found.high)]
    return f"({said[0]} to {said[1]})"


def _section(title: str, words: str, *content: object) -> Html:
    return joined((tag("h2", title), tag("p", words, css="soft"), *content))


def _shares_section(found: Sequence[Share]) -> Html:
    rows = [
        (one.title, f"{one.count} of {one.of}", percent(one.estimate.value))
        + (bounds(one.estimate, percent),)
        for one in found
    ]
    words = f"Of all patients, failed ones too. {EVERY[:-1]} (Clopper and Pearson)."
    return _section(
        "Shares", words, table(("", "Patients", "Share", ""), rows, ("", "n", "n", "n"))
    )


def _failures_section(rows: Sequence[Row]) -> Html:
    found = failures_of(rows)
    if not found:
        return Html("")
    lines = [(step, code, count, reason) for step, code, count, reason in found]
    words = "By step and code, with the reason of the first of each kind."
    head = ("Step", "Code", "Patients", "Reason")
    return _section("Failures", words, table(head, lines, ("name", "name", "n own", "")))


# ------------------------------------------------------------------ figures


def _figures_section(rows: Sequence[Row]) -> Html:
    words = (
        "Of the patients that have the figure. The bar of the drawing is from 25 to 75 %, the line "
        f"from 5 to 95 %, the notch the median, the red line the limit. {EVERY}"
    )
    head = ("Figure", "n", "5 %", "Median", "95 %", "Worst", "", "Limit", "Beyond it")
    kinds = ("", *["n own"] * 5, "", "n own", "n own")
    parts: list[Html] = []
    for title, lines in figure_lines(rows).items():
        parts += [tag("h3", title), table(head, map(_figure_row, lines), kinds)]
    return _section("Figures", words, *parts)


@dataclass(frozen=True, slots=True)
class FigureLine:
    """One figure of all patients that have it: quantiles, worst value, limit, share beyond it."""

    figure: Figure
    sample: Floats  # (n,)
    quantiles: tuple[Estimate, Estimate, Estimate]  # 5 %, median, 95 %
    worst: str  # empty where there is no limit
    limit: str
    beyond: Share | None


def figure_lines(rows: Sequence[Row]) -> dict[str, list[FigureLine]]:
    """Return the figures that patients have, by section of the list of figures."""
    found: dict[str, list[FigureLine]] = {}
    for title, figures in SECTIONS.items():
        for figure in figures:
            if (sample := values(rows, figure.key)).size:
                limit = "" if figure.limit is None else figure.words(figure.limit)
                sign = "≤" if figure.sense == "at most" else "≥"
                line = FigureLine(
                    figure,
                    sample,
                    (quantile(sample, 0.05), quantile(sample, 0.5), quantile(sample, 0.95)),
                    "" if figure.limit is None else figure.words(worst(sample, figure)),
                    limit and f"{sign} {limit}",
                    beyond_limit(rows, figure),
                )
                found.setdefault(title, []).append(line)
    return found


def _figure_row(line: FigureLine) -> tuple[object, ...]:
    beyond = None if line.beyond is None else line.beyond.estimate
    return (
        line.figure.title,
        len(line.sample),
        *(_stacked(one, line.figure) for one in line.quantiles),
        line.worst,
        _strip(line.sample, line.figure),
        line.limit,
        "" if beyond is None else _lines(percent(beyond.value), bounds(beyond, percent)),
    )


def _stacked(found: Estimate, figure: Figure) -> Html:
    def plain(value: float) -> str:
        return figure.words(value).removesuffix(figure.unit).rstrip()

    return _lines(figure.words(found.value), bounds(found, plain))


def _lines(first: str, second: str) -> Html:
    return joined((first, Html("<br>"), tag("small", second)))


def _strip(sample: Floats, figure: Figure) -> Html:
    """Return a distribution as a small drawing: 5, 25, 50, 75 and 95 %, and the limit."""
    five = [float(q) for q in np.quantile(sample, (0.05, 0.25, 0.5, 0.75, 0.95))]
    shown = [*five, 0.0] if figure.limit is None else [*five, 0.0, figure.limit]
    low, high = min(shown), max(shown)
    scale = (STRIP - 4.0) / ((high - low) or 1.0)
    x = [2.0 + scale * (value - low) for value in five]
    middle = STRIP_HEIGHT / 2.0
    parts = [
        f'<path class="frame" d="M{x[0]:.1f} {middle:g}H{x[4]:.1f}"/>',
        f'<rect x="{x[1]:.1f}" y="4" width="{max(x[3] - x[1], 1.0):.1f}" height="8" '
        'fill="var(--band)"/>',
        f'<path d="M{x[2]:.1f} 1V15" stroke="var(--ink)" stroke-width="1.6"/>',
    ]
    if figure.limit is not None:
        at = 2.0 + scale * (figure.limit - low)
        parts.append(f'<path d="M{at:.1f} 0V16" stroke="var(--bad)" stroke-width="1.4"/>')
    box = f'<svg viewBox="0 0 {STRIP:g} {STRIP_HEIGHT:g}" style="width:{STRIP:g}px"'
    return Html(f'{box} role="img" aria-label="distribution">{"".join(parts)}</svg>')


# ------------------------------------------------------------------ sensitivity


EFFECTS = ("Factor", "Figure", "Share", "Median by level")


def effect_lines(plan: Plan, rows: Sequence[Row]) -> tuple[str, list[tuple[str, str, str, str]]]:
    """Return what figures depend on: words, and a line for each pair under the head `EFFECTS`."""
    found, tried = effects(plan, rows)
    lines = [
        (
            one.factor,
            one.figure.title,
            percent(one.share),
            "; ".join(f"{name}: {one.figure.words(median)}" for name, median in one.medians),
        )
        for one in found[:MOST_EFFECTS]
    ]
    words = (
        f"Which factors a figure with a limit depends on: {len(found)} of {tried} pairs, at 5 % "
        "for all pairs together. The share is that of the variance of the ranks of the patients "
        "(Spearman for numbers, Kruskal and Wallis otherwise)."
    )
    return words, lines


def _effects_section(plan: Plan, rows: Sequence[Row]) -> Html:
    if not plan.varied:
        return Html("")
    words, lines = effect_lines(plan, rows)
    shown = table(EFFECTS, lines, ("name", "", "n own", "")) if lines else ""
    return _section("Sensitivity", words, shown)


# ------------------------------------------------------------------ calibration


def _calibration_section(rows: Sequence[Row]) -> Html:
    found = calibrations(rows)
    if not found:
        return Html("")
    lines = [
        (
            one.figure.title,
            len(one.ratios),
            f"{one.square.value:.2f} {bounds(one.square, '{:.2f}'.format)}",
            *(f"{sigma:.3g} : {truth:.3g}" for sigma, truth in one.bands),
        )
        for one in found
    ]
    words = (
        "Ratio: mean of (truth / predicted)², 1 where a prediction is honest, above where it says "
        f"too little. Bands: RMS predicted : RMS true, mm, in thirds of the predictions. {EVERY} "
        f"Stated from {FEWEST} patients on."
    )
    head = ("Figure", "n", "Ratio", "Lowest third", "Middle third", "Highest third")
    says = "Share of patients (%) whose truth is within so many times the prediction."
    curves = tag("div", *(tag("figure", _curve(one)) for one in found), css="maps")
    kinds = ("", *["n own"] * 5)
    shown = table(head, lines, kinds)
    return _section("Calibration of predictions", words, shown, tag("p", says, css="soft"), curves)


def _curve(one: Calibration) -> Html:
    """Return which share of the patients lies within so many predicted sigmas, as SVG."""
    bottom, width = CURVE_TOP + CURVE_HEIGHT, CURVE - CURVE_LEFT - 8.0
    count = len(one.ratios)
    steps = f"M{CURVE_LEFT:g} {bottom:g}"
    for place, ratio in enumerate(one.ratios.tolist(), 1):
        if ratio > MOST_SIGMAS:
            break
        steps += f"H{CURVE_LEFT + width * ratio / MOST_SIGMAS:.1f}"
        steps += f"V{bottom - CURVE_HEIGHT * place / count:.1f}"
    parts = [
        f'<text class="title" x="{CURVE_LEFT:g}" y="13">{markup(one.figure.title)}</text>',
        *(
            f'<path class="tick" d="M{CURVE_LEFT:g} {y:.1f}h{width:g}"/>'
            f'<text x="{CURVE_LEFT - 5.0:g}" y="{y + 4.0:.1f}" text-anchor="end">{percent}</text>'
            for percent in (0, 50, 95)
            for y in [bottom - CURVE_HEIGHT * percent / 100.0]
        ),
        *(
            f'<text x="{CURVE_LEFT + width * k / MOST_SIGMAS:.1f}" y="{bottom + 15.0:g}" '
            f'text-anchor="middle">{k} σ</text>'
            for k in range(MOST_SIGMAS + 1)
        ),
        f'<path d="{steps}H{CURVE_LEFT + width:g}" fill="none" stroke="var(--band)" '
        'stroke-width="1.6"/>',
    ]
    box = f'<svg viewBox="0 0 {CURVE:g} {bottom + CURVE_BELOW:g}" role="img"'
    label = tag("title", f"calibration of {one.figure.title}")
    return Html(f"{box}>{label}{''.join(parts)}</svg>")


# ------------------------------------------------------------------ patients


def _chosen_section(rule: KeepRule, plan: Plan, rows: Sequence[Row], folder: StudyFolder) -> Html:
    """Return the patients that a rule chooses, with links to their sessions."""
    lines = [
        (
            row["seed"],
            "; ".join(f"{name} {row.get(name)}" for name in plan.varied),
            rule.figure.words(float(row[rule.figure.key])),
            _link(folder, str(row["key"])),
        )
        for row in rule.chosen(rows)
    ]
    head = ("Seed", "Levels", rule.figure.title, "Session")
    shown = table(head, lines, ("n own", "", "n own", "name"))
    title = f"{rule.which.capitalize()} {rule.count}: {rule.figure.title}"
    return _section(title, "Open a session with rona serve.", shown)


def _link(folder: StudyFolder, key: str) -> Html:
    path = folder.session(key)
    if not path.is_file():
        return Html("not kept yet")
    name = path.relative_to(folder.path).as_posix()
    return Html(f'<a href="{name}">{tag("span", path.name)}</a>')
