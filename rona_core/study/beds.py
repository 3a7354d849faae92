"""What a study found of the beds of its patients, as the file that the risk of a bed is read from.

`rona_core.app.overview.bed_risk` reads it.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import cast

from rona_core.app.overview.bed_risk import StudiedBeds, conditions_of
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import Row
from rona_core.study.plan import Plan, number
from rona_core.study.statistics import has_bed

SEARCH = "implant"  # stage that finds a bed


def beds_file(folder: StudyFolder) -> bytes | None:
    """Return the beds of a study as JSON; None where it says nothing of beds.

    It does if it goes to the search of a bed, its patients differ by their seed alone, and it keeps
    the session of one who has a bed: that has the settings of all.

    Raises:
        NotFoundError: no study was run there.
        SessionFormatError: the session is not readable.
    """
    plan = folder.plan()
    rows = list(folder.rows(plan).values())
    if plan.varied or SEARCH not in {stage.name for stage in plan.stages}:
        return None
    kept = (folder.session(str(row["key"])) for row in rows if _is_known(row))
    path = next((path for path in kept if path.is_file()), None)
    if path is None:
        return None
    found = asdict(studied_beds(plan, rows, load_session(path)))
    return json.dumps(found, ensure_ascii=False).encode()


def studied_beds(plan: Plan, rows: Sequence[Row], session: Session) -> StudiedBeds:
    """Return the beds of the rows of a study; `session` is that of one patient with a bed."""
    bed = cast(ImplantBed, session.results.more["bed"].value)
    accepted = [row for row in rows if _is_known(row)]
    no_bed = sum(row.get("bed_reason") is not None for row in rows)
    seeds = [int(row["seed"]) for row in rows]
    return StudiedBeds(
        title=plan.title,
        version=", ".join(sorted({str(row["version"]) for row in rows})),
        first_seed=min(seeds),
        last_seed=max(seeds),
        conditions=conditions_of(session),
        limit_mm=bed.limit_mm,
        failed=len(rows) - len(accepted) - no_bed,
        no_bed=no_bed,
        beds=tuple(
            (float(row["bed_probability"]), float(row["bed_residual_true_mm"])) for row in accepted
        ),
    )


def _is_known(row: Row) -> bool:
    """Return whether a safe bed was found, and what it leaves in truth is known."""
    return has_bed(row) and number(row.get("bed_residual_true_mm")) is not None
