"""What a study found of the beds of its patients, as the file that the risk of a bed is read from.

`rona_core.app.overview.bed_risk` reads it.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import cast

from rona_core.app.messages.message import serialize_arguments
from rona_core.app.overview.bed_risk import StudiedBeds, conditions_from
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.compose import planned_setup
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import Row
from rona_core.study.plan import Plan, number
from rona_core.study.statistics import has_bed

SEARCH = "implant"  # stage that finds a bed
LEFT_OUT = ("second_pass_reason", "references_reason")  # figures: why a stage before was left out


def beds_file(folder: StudyFolder) -> bytes | None:
    """Return the beds of a study as JSON; None where it says nothing of beds.

    It does if it goes to the search of a bed, its patients differ by their seed alone, and one of
    them has been run.

    Raises:
        NotFoundError: no study was run there.
        RonaError: the set-up of its patients is invalid.
    """
    plan = folder.plan()
    rows = list(folder.rows(plan).values())
    if plan.varied or SEARCH not in {stage.name for stage in plan.stages} or not rows:
        return None
    return json.dumps(asdict(studied_beds(plan, rows)), ensure_ascii=False).encode()


def studied_beds(plan: Plan, rows: Sequence[Row]) -> StudiedBeds:
    """Return the beds of the rows, at least one, of a study whose patients have one set-up.

    Patients for whom an offered stage was left out have other conditions: they count as `failed`.
    """
    patient = plan.patients()[0]
    search = next(stage.message for stage in patient.stages if stage.name == SEARCH)
    like = [row for row in rows if all(row.get(reason) is None for reason in LEFT_OUT)]
    accepted = [row for row in like if _is_known(row)]
    no_bed = sum(row.get("bed_reason") is not None for row in like)
    seeds = [int(row["seed"]) for row in rows]
    return StudiedBeds(
        title=plan.title,
        version=", ".join(sorted({str(row["version"]) for row in rows})),
        first_seed=min(seeds),
        last_seed=max(seeds),
        conditions=conditions_from(
            planned_setup(patient.seed, patient.settings, patient.skull),
            serialize_arguments(search),
            {stage.makes for stage in patient.stages},
        ),
        limit_mm=cast(StartBedSearch, search).limit_mm,
        failed=len(rows) - len(accepted) - no_bed,
        no_bed=no_bed,
        beds=tuple(
            (float(row["bed_probability"]), float(row["bed_residual_true_mm"])) for row in accepted
        ),
    )


def _is_known(row: Row) -> bool:
    """Return whether a safe bed was found, and what it leaves in truth is known."""
    return has_bed(row) and number(row.get("bed_residual_true_mm")) is not None
