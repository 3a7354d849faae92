"""Draw the picture of every example: ``make gallery`` writes docs/images/gallery."""

from pathlib import Path

from examples import (
    compare_pointers,
    compare_rolls,
    plate_thickness,
    pointer_poses,
    scan_by_hand,
    simplify_path,
    thickness_along_scan,
    time_offset,
    verify_motion,
)
from examples.picture import Series, chart

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images" / "gallery"
QUICK = {
    example.__name__.rpartition(".")[2]: example.main
    for example in (
        compare_rolls,
        plate_thickness,
        pointer_poses,
        simplify_path,
        thickness_along_scan,
        time_offset,
        verify_motion,
    )
}


def pointers() -> str:
    """Return a chart of the errors with either pointer."""
    found = compare_pointers.main()
    dots = [Series(kind, compare_pointers.SEEDS, e, dots=True) for kind, e in found.items()]
    return chart("Surface cloud by a 6D and a 5D pointer", "seed", "RMS error (mm)", dots)


def by_hand() -> str:
    """Return a chart of the errors of a scan by hand."""
    errors = {k: v for k, v in scan_by_hand.main().items() if k.endswith("_rms_mm")}
    dots = [Series(name, [k], [v], dots=True) for k, (name, v) in enumerate(errors.items())]
    return chart("Maps of a scan by hand", "", "RMS error (mm)", dots)


def write(folder: Path = FOLDER) -> None:
    """Write all pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    slow = {"compare_pointers": pointers, "scan_by_hand": by_hand}
    for name, draw in (QUICK | slow).items():
        (folder / f"{name}.svg").write_text(draw(), "utf-8")


if __name__ == "__main__":
    write()
