"""Tables of poses as trackers and spreadsheets write them give the same poses as plain rows."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.devices.files.poses.recorded_poses import read_pivot
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from tests.helpers.pivot_data import TIP, matrices, poses

MADE = poses(0, n=60, sigma_mm=0.1)[0]
Q = Rotation.from_matrix(MADE.rotations).as_quat(scalar_first=True)
P = MADE.translations
M = matrices(MADE).reshape(-1, 16)
T = np.arange(60)[:, None] / 20.0
UNSEEN = np.arange(60) % 7 == 3
NDI = "Tools,Port 1,Frame,Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error"


def text(values, separator=",", header="", point="."):
    lines = [separator.join(f"{v:.9f}" for v in row).replace(".", point) for row in values]
    return "\n".join(([header] if header else []) + lines) + "\n"


def without(stand_in, columns=16):
    """Rows of matrices with a stand-in where the marker was not seen."""
    lines = text(M).splitlines()
    return "\n".join(stand_in if UNSEEN[i] else line for i, line in enumerate(lines))


def ndi():
    rows = [NDI]
    for i in range(60):
        good = ",".join(f"{v:.6f}" for v in (*Q[i], *P[i], 0.15))
        rows.append(
            f"1,Port:10,{900 + i},0," + ("MISSING" + 8 * "," if UNSEEN[i] else f"OK,{good}")
        )
    return "\n".join(rows)


def by_columns():
    header = ",".join(f"m{j}{i}" for i in range(4) for j in range(4))  # written column by column
    return text(np.swapaxes(matrices(MADE), 1, 2).reshape(-1, 16), header=header)


SAME = {
    "twelve numbers": text(M[:, :12]),
    "time and twelve": text(np.hstack((T, M[:, :12]))),
    "time and matrix": text(np.hstack((T, M))),
    "x y z qx qy qz qw": text(np.hstack((P, Q[:, 1:], Q[:, :1])), " "),
    "time x y z qx qy qz qw": text(np.hstack((T, P, Q[:, 1:], Q[:, :1])), " "),
    "qw qx qy qz x y z": text(np.hstack((Q, P)), "\t"),
    "names in any order": text(np.hstack((Q, P)), ";", "q0;q1;q2;q3;Tx [mm];Ty [mm];Tz [mm]"),
    "names and real part last": text(
        np.hstack((T, P, Q[:, 1:], Q[:, :1])), ",", "time,x,y,z,qx,qy,qz,qw"
    ),
    "indices say the order": by_columns(),
    "decimal commas and tabs": text(M, "\t", point=","),
    "decimal commas and spaces": text(M, " ", point=","),
    "decimal commas and semicolons": text(M, ";", point=","),
}
SOME = {
    "ndi": ndi(),
    "identity": without(",".join("1" if i % 5 == 0 else "0" for i in range(16))),
    "zeros": without(",".join(["0"] * 16)),
    "nan": without(",".join(["nan"] * 16)),
    "bad float": without(",".join(["-3.697314E28"] * 12 + ["0", "0", "0", "1"])),
    "empty cells": without("," * 15),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("words", SAME.values(), ids=SAME)
def test_the_same_poses(words, encoding):
    found = read_pivot([NamedFile("p.txt", words.encode(encoding))])
    poses_found = found.track.Ts_tracker_marker
    np.testing.assert_allclose(poses_found.rotations, MADE.rotations, atol=1e-7)
    np.testing.assert_allclose(poses_found.translations, P, atol=1e-7)
    assert found.track.n_frames == 60


@pytest.mark.parametrize("words", SOME.values(), ids=SOME)
def test_rows_of_a_marker_not_seen_are_frames_without_a_pose(words):
    found = report_pivot([NamedFile("p.csv", words.encode())])
    track = found.pivot.track
    np.testing.assert_allclose(track.Ts_tracker_marker.translations, P[~UNSEEN], atol=1e-5)
    np.testing.assert_array_equal(np.diff(track.frame_numbers), np.diff(np.flatnonzero(~UNSEEN)))
    assert track.n_frames == 60
    assert (found.calibration.verdict, found.calibration.n_rejected) == ("good", 0)
    assert np.linalg.norm(found.calibration.tip_marker - TIP) < 0.5


REFUSED = {
    "never seen": (without(",".join(["0"] * 16)).splitlines()[3], "seen in no frame"),
    "long quaternion": (text(np.hstack((P, 2.0 * Q))), "line 1: expected a quaternion of length 1"),
    "two tools": (
        text(np.hstack((Q, P, Q, P)), ",", "q0,qx,qy,qz,x,y,z,q0,qx,qy,qz,x,y,z"),
        "twice|2 t",
    ),
    "other widths": (text(np.hstack((M, M, M))), "expected 16 or 12 numbers .* got 48 cells"),
    "a word": (ndi().replace("OK,0", "OK,x0", 1), "line 2: expected a number, got 'x0"),
}


@pytest.mark.parametrize(("words", "said"), REFUSED.values(), ids=REFUSED)
def test_others_are_refused_by_place(words, said):
    with pytest.raises(InvalidInputError, match=said):
        read_pivot([NamedFile("p.csv", words.encode())])


def test_the_order_that_a_refusal_names_is_the_remedy():
    """Real part first without names is read as real part last: refused, and names mend it."""
    values = np.hstack((P, Q))
    with pytest.raises(InvalidInputError, match="Name the columns qw, qx, qy, qz") as refused:
        report_pivot([NamedFile("p.csv", text(values).encode())])
    assert refused.value.data["change"] == "real part first"
    named = text(values, header="x,y,z,qw,qx,qy,qz")
    assert report_pivot([NamedFile("p.csv", named.encode())]).calibration.verdict == "good"
