"""Awkward files of poses beside the repository, each with its right answer; skipped without them.

They are looked for in the folder that RONA_AWKWARD names, else in shared/data/awkward beside the
repository or above it.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.errors import InvalidInputError

HERE = Path(__file__).resolve()
PLACES = [parent / "shared" / "data" / "awkward" for parent in HERE.parents]
if os.environ.get("RONA_AWKWARD"):
    PLACES = [Path(os.environ["RONA_AWKWARD"])]
FOLDER = next((place / "poses" for place in PLACES if (place / "poses").is_dir()), None)
pytestmark = pytest.mark.skipif(FOLDER is None, reason="no awkward files: set RONA_AWKWARD")
TIP = (12.0, -7.0, -160.0)
READ = {  # poses used
    "a_reference.csv": 300,
    "t_identity_rows.csv": 282,
    "p_ndi.csv": 282,
    "q_seven.txt": 300,
    "n_time_and_matrix.csv": 300,
    "i_comma_tab.txt": 300,
    "g_utf16.txt": 300,
    "s_ndi_bad_float.csv": 282,
    "c_same_stamp_twice.igs.mha": 300,
    "f_to_reference.igs.mha": 300,
    "u_frozen_block.csv": 241,
}
REFUSED = {"c_inverse.csv": "inverted", "b_rotation_transposed.csv": "transposed"}


@pytest.mark.parametrize("name", READ)
def test_the_tip_is_found(name):
    found = report_pivot([FOLDER / name]).calibration
    assert (found.verdict, found.n_used) == ("good", READ[name])
    assert np.linalg.norm(found.tip_marker - TIP) < 0.16


@pytest.mark.parametrize("name", REFUSED)
def test_another_convention_is_named(name):
    with pytest.raises(InvalidInputError) as refused:
        report_pivot([FOLDER / name])
    assert refused.value.data["change"] == REFUSED[name]


def test_no_file_is_forgotten():
    assert {path.name for path in FOLDER.iterdir()} == {*READ, *REFUSED}
