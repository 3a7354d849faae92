"""Where the figures of the chosen robot come from, as a table."""

from rona_core.app.steps.setup.robot_parameters import robot_figures
from rona_core.errors import RonaError
from rona_ui.panels.widgets import style
from rona_ui.viewer.bindings import escape


def figures_table(model: str) -> str:
    """Return the table as HTML; what nobody states comes first and says so."""
    try:
        rows = robot_figures(model)
    except RonaError as error:
        return style.note(error, "warn")
    assumed = sum(not row.sourced for row in rows)
    body = ""
    for row in sorted(rows, key=lambda row: row.sourced):
        values = ", ".join(f"{value:.5g}" for value in row.values).replace("-", "−")
        trust = row.trust if row.sourced else f"▲ {row.trust}"
        body += (
            f"<tr><td>{escape(row.name)}<br><b>{escape(values)}</b> {escape(row.unit)}<br>"
            f'<span class="g">{escape(trust)}: {escape(row.source)}</span></td></tr>'
        )
    words = style.text(
        f"{len(rows)} figures, {assumed} of them assumed (marked ▲). All can be overridden in "
        "Python: robot_model(name, overrides)."
    )
    return f'{words}<table class="r-table">{body}</table>'
