"""How much does a 5D pointer cost in accuracy? Steps 2 to 4 with either pointer, over three seeds.

Run it with the Python of the project: .venv/bin/python examples/compare_pointers.py
"""

from statistics import median

from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetPointer, SetSeed
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.devices.settings import PointerKind
from rona_core.session.document import Session

SEEDS = (0, 1, 2)


def surface_rms_mm(kind: PointerKind, seed: int, surface: StartSurfaceCapture) -> float:
    """Return the error of the surface cloud against the truth, which a virtual scene knows."""
    bench = new_workbench(Session(name=kind))
    try:
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetPointer(kind))
        for activity in (StartToolCapture(), StartPointerCapture(), surface):
            bench.run(activity)
        return bench.figures()["surface_rms_mm"]
    finally:
        bench.close()


def main(
    seeds: tuple[int, ...] = SEEDS, surface: StartSurfaceCapture | None = None
) -> dict[PointerKind, list[float]]:
    kinds: tuple[PointerKind, ...] = ("pointer6d", "pointer5d")
    stroke = surface or StartSurfaceCapture()
    found = {kind: [surface_rms_mm(kind, seed, stroke) for seed in seeds] for kind in kinds}
    for kind, errors in found.items():
        print(f"{kind}: median {median(errors):.2f} mm, worst {max(errors):.2f} mm")
    return found


if __name__ == "__main__":
    main()
