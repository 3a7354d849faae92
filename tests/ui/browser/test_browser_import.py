"""Recordings in a real browser: a pivot from a file is calibrated, and saved as a sequence file."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rona_core.devices.files.poses.sequences import read_igs_mha
from tests.helpers.pivot_data import TIP, poses, rows_file
from tests.helpers.ui import hand
from tests.helpers.ui.browser_driver import Surgeon, running_server
from tests.helpers.ui.clicks import new_session

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server of its own: no session of another file is left unsaved in it."""
    with running_server(tmp_path_factory.mktemp("import"), pace=2.0) as address:
        yield address


def test_a_pivot_is_imported_and_what_was_imported_is_downloaded(
    surgeon: Surgeon, tmp_path: Path
) -> None:
    frame, page = surgeon.frame, surgeon.page
    new_session(surgeon)

    made, _ = poses(n=60, sigma_mm=0.1)
    file = tmp_path / "pivot.csv"
    file.write_bytes(rows_file(made).data)
    surgeon.open_step("Pointer")
    hand.unfold(surgeon, "Import recording")
    hand.choose_file(surgeon, "Choose file", file)
    surgeon.wait_state("Pointer", "done")
    note = frame.get_by_text("Tip at (").inner_text()
    found = [float(part) for part in note.partition("(")[2].partition(")")[0].split(",")]
    np.testing.assert_allclose(found, TIP, atol=0.5)

    with page.expect_download() as download:
        surgeon.menu("sessionbutton", "1: pointer, marker")
    assert download.value.suggested_filename == "untitled_1_marker.igs.mha"
    saved = tmp_path / "back.igs.mha"
    download.value.save_as(saved)
    track = read_igs_mha(saved.read_bytes()).track("marker")
    assert track.Ts_tracker_marker.translations.tobytes() == made.translations.tobytes()
    assert surgeon.errors == []


def test_captures_are_exported_and_loaded_into_an_empty_session(
    surgeon: Surgeon, tmp_path: Path
) -> None:
    surgeon.open_demo()
    surgeon.open_step("Scan")
    hand.unfold(surgeon, "Export captures")
    with surgeon.page.expect_download() as download:
        surgeon.button("Download captures").click()
    file = tmp_path / "mine.h5"
    download.value.save_as(file)
    new_session(surgeon)
    surgeon.open_step("Scan")
    hand.unfold(surgeon, "Load captures")
    hand.choose_file(surgeon, "Choose file", file)
    surgeon.wait_state("Surface", "done")
    surgeon.frame.get_by_text("from mine.h5").wait_for()
    surgeon.open_step("Tool")
    surgeon.frame.get_by_text("Imported: the motion of the tool, from mine.h5.").wait_for()
    assert surgeon.errors == []
