"""Report of a study as a page of documentation, in Markdown, without drawings."""

from collections.abc import Iterable, Sequence

from rona_core.study.folder import StudyFolder
from rona_core.study.patient import Row
from rona_core.study.plan import Plan
from rona_core.study.report import EFFECTS, FigureLine, bounds, effect_lines, figure_lines, percent
from rona_core.study.statistics import CONFIDENCE, calibrations, shares
from rona_core.study.study import failures_of


def study_markdown(folder: StudyFolder) -> str:
    """Return the report of a study as Markdown, without its drawings and its worst patients.

    Raises:
        NotFoundError: no study was run there.
    """
    plan = folder.plan()
    rows = list(folder.rows(plan).values())
    parts = [
        f"# {plan.title}\n",
        _head(plan, rows),
        f"\n## Shares\n\nOf all patients; in brackets the interval of {CONFIDENCE:.0%}.\n",
        *_shares(plan, rows),
        *_failures(rows),
        *_figures(rows),
        *_effects(plan, rows),
        *_calibration(rows),
        "",
    ]
    return "\n".join(parts)


def _head(plan: Plan, rows: Sequence[Row]) -> str:
    versions = ", ".join(sorted({str(row["version"]) for row in rows})) or "none yet"
    seeds = sorted(int(row["seed"]) for row in rows)
    drawn = f"seeds {seeds[0]} to {seeds[-1]}" if seeds else "no patient yet"
    return (
        f"{len(rows)} of {len(plan.patients())} virtual patients of the plan below, {drawn}, "
        f"version {versions}. Every figure is measured against the ground truth.\n\n"
        f"```toml\n{plan.text.strip()}\n```"
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]


def _shares(plan: Plan, rows: Sequence[Row]) -> list[str]:
    found = shares(plan, rows)
    return _table(
        ("", "patients", "share"),
        (
            (
                one.title,
                f"{one.count} of {one.of}",
                f"{percent(one.estimate.value)} {bounds(one.estimate, percent)}",
            )
            for one in found
        ),
    )


def _failures(rows: Sequence[Row]) -> list[str]:
    found = failures_of(rows)
    if not found:
        return []
    head = ("step", "code", "patients", "reason of the first")
    cells = ((step, code, count, reason) for step, code, count, reason in found)
    return ["\n## Failures\n", *_table(head, cells)]


def _figures(rows: Sequence[Row]) -> list[str]:
    found = figure_lines(rows)
    lines = ["\n## Figures\n\nOf the patients that have the figure."]
    head = ("figure", "patients", "5 %", "median", "95 %", "worst", "limit", "beyond it")
    for title, of in found.items():
        lines += [f"\n### {title}\n", *_table(head, map(_figure, of))]
    return lines


def _figure(line: FigureLine) -> tuple[object, ...]:
    figure = line.figure
    beyond = None if line.beyond is None else line.beyond.estimate
    return (
        f"{figure.title} (`{figure.key}`)",
        len(line.sample),
        *(figure.words(one.value) for one in line.quantiles),
        line.worst,
        line.limit,
        "" if beyond is None else f"{percent(beyond.value)} {bounds(beyond, percent)}",
    )


def _effects(plan: Plan, rows: Sequence[Row]) -> list[str]:
    if not plan.varied:
        return []
    words, lines = effect_lines(plan, rows)
    return [f"\n## Sensitivity\n\n{words}\n", *(_table(EFFECTS, lines) if lines else [])]


def _calibration(rows: Sequence[Row]) -> list[str]:
    found = calibrations(rows)
    if not found:
        return []
    words = (
        "\n## Calibration of predictions\n\nRatio: mean of (truth / predicted)², 1 where a "
        "prediction is honest. Thirds of the patients by their prediction: RMS predicted : RMS "
        "true, mm.\n"
    )
    head = ("figure", "patients", "ratio", "lowest", "middle", "highest")
    cells = (
        (
            one.figure.title,
            len(one.ratios),
            f"{one.square.value:.2f} {bounds(one.square, '{:.2f}'.format)}",
            *(f"{sigma:.3g} : {truth:.3g}" for sigma, truth in one.bands),
        )
        for one in found
    )
    return [words, *_table(head, cells)]
