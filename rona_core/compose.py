"""Put the parts together: sessions with virtual devices, and the whole procedure in one call."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from rona_core.app.declarations.declarations import Compute, Message, compute_here
from rona_core.app.dependencies.staleness import required
from rona_core.app.overview.predicted_accuracy import predicted_figures
from rona_core.app.procedure import (
    TO_MAPS,
    Ending,
    Stages,
    StepProgress,
    run_procedure,
    unwatched,
)
from rona_core.app.runtime.process_pool import ProcessCompute
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.workbench import Services, Workbench
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.rehearsal import Rehearsal, derive_rehearsal
from rona_core.app.steps.implant.view import milling_model, milling_view
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.setup.messages import (
    SetProbe,
    SetRegion,
    SetRobot,
    SetSeed,
    SetWorld,
    StoreSkull,
)
from rona_core.devices.protocols import Cancel, Progress, Rig, Work, never
from rona_core.devices.settings import ProbeSettings
from rona_core.devices.world_settings import REALISTIC_WORLD, WorldSettings
from rona_core.errors import DeviceError, RonaError
from rona_core.evaluation.map_metrics import errors_of_maps
from rona_core.evaluation.metrics import evaluate
from rona_core.evaluation.truth import truth_of
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.session.document import Session, Setup
from rona_core.session.files import load_session
from rona_core.session.specimen import LoadedSkull
from rona_core.ultrasound.acoustic_calibration.expected_performance import sweep
from rona_core.virtual.acoustics.plates import record_plate
from rona_core.virtual.milling.milling_site import VirtualMillingSite
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.specimen.build_specimen import Specimen, build_specimen
from rona_core.virtual.world.world import World, draw_world


def specimen_of(setup: Setup) -> Specimen:
    """Return the specimen that a set-up puts on the table.

    Raises:
        InvalidInputError: the chosen region lies outside a loaded skull's stored part.
    """
    return build_specimen(
        setup.specimen,
        setup.seed,
        center_mesh_mm=setup.region.center_mesh_mm,
        radius_mm=setup.region.radius_mm,
        relief=world_of(setup).relief,
    )


def require_region_on_bone(setup: Setup) -> None:
    """Raise InvalidInputError where the region of a set-up is off its bone.

    What is built to see it is shared with the devices that need it next.
    """
    chosen = setup.region.center_mesh_mm is not None
    if chosen or isinstance(setup.specimen, LoadedSkull):
        specimen_of(setup)


def world_of(setup: Setup) -> World:
    """Return what patient and devices of a set-up really are."""
    return draw_world(setup.world, setup.bone, setup.seed)


def build_virtual_rig(setup: Setup, pace: float | None = None) -> VirtualRig:
    """Return virtual devices; ``pace`` is a multiple of real time, None shows captures at once."""
    world = world_of(setup)
    return VirtualRig(setup.seed, specimen_of(setup), setup.devices, pace, world)


def read_skull(
    path: str,
    inner: str | None,
    threshold: float | None,
    center_mesh_mm: tuple[float, float, float] | None,
    radius_mm: float,
    label: int | None = None,
    **work: Unpack[Work],
) -> LoadedSkull:
    """Read a skull from a file; picklable, so that it can run in another process."""
    from rona_core.virtual.specimen.import_skull import import_skull  # readers of many formats

    return import_skull(
        path,
        inner=inner,
        threshold=threshold,
        label=label,
        center=center_mesh_mm,
        radius_mm=radius_mm,
        **work,
    )


def evaluate_virtual(session: Session, rig: Rig) -> dict[str, Any]:
    """Return the figures of a session against the ground truth of its virtual devices.

    Raises:
        DeviceError: the devices are real: there is no ground truth.
    """
    if not isinstance(rig, VirtualRig):
        raise DeviceError("figures against ground truth need virtual devices")
    return evaluate(session, rig.scene)


def virtual_map_errors(session: Session, rig: Rig) -> MapErrors:
    """Return the errors of the robot's maps against the true bone of its virtual devices.

    Raises:
        DeviceError: the devices are real: there is no ground truth.
        StepBlockedError: nothing was mapped.
    """
    if not isinstance(rig, VirtualRig):
        raise DeviceError("errors against ground truth need virtual devices")
    return errors_of_maps(required(MAPS, session), truth_of(session, rig.scene))


def milling_site(session: Session, number: int) -> VirtualMillingSite:
    """Return the true bone of a session's bed with burr and probe, for one of its rehearsals."""
    model = milling_model(session, milling_view(session))
    return VirtualMillingSite(build_virtual_rig(session.setup).scene, model, number)


def rehearse_virtually(
    session: Session, message: RehearseMilling, *, progress: Progress, cancel: Cancel
) -> Rehearsal:
    """Rehearse the planned milling on the true bone; picklable, so that it can run elsewhere."""
    site = milling_site(session, message.number)
    return derive_rehearsal(session, message, site, progress=progress, cancel=cancel)


def virtual_services(compute: Compute = compute_here, pace: float | None = None) -> Services:
    """Return what a workbench needs to work with virtual devices."""
    return Services(
        build_rig=lambda setup: build_virtual_rig(setup, pace),
        import_skull=read_skull,
        evaluate=evaluate_virtual,
        compute=compute,
        sweep=partial(sweep, record=record_plate),
        rehearse=rehearse_virtually,
        predict=predicted_figures,
        map_errors=virtual_map_errors,
        check_bone=require_region_on_bone,
    )


def build_registry(
    folder: Path, *, processes: bool = True, pace: float | None = None
) -> SessionRegistry:
    """Return a hub of sessions with virtual devices, whose files live in ``folder``.

    With ``processes`` computations run in another process, so that the server always answers.
    """
    if not processes:
        return SessionRegistry(virtual_services(pace=pace), folder)
    pool = ProcessCompute()
    pool.warm_up()
    return SessionRegistry(virtual_services(pool, pace), folder, on_close=pool.close)


def new_workbench(session: Session, uploads: Path | None = None) -> Workbench:
    """Return a workbench with virtual devices for one session, for scripts and tests."""
    return Workbench(session, virtual_services(), uploads or Path.cwd())


@dataclass(frozen=True, slots=True)
class DemoSkull:
    """The skull of a demo: simulated, or read from a file, and the region of it that is scanned."""

    path: str | None = None  # mask, CT volume or mesh; None: a simulated skull
    inner: str | None = None  # the inner surface, where it is a file of its own
    threshold: float | None = None  # of the bone in a CT volume
    center: tuple[float, float, float] | None = None  # of the region, in mm of the file
    radius: float | None = None  # of the region in mm, 25 if not given
    label: int | None = None  # of the bone in a map of labels

    @property
    def name(self) -> str:
        """What the figures call it."""
        return "simulated" if self.path is None else Path(self.path).name


SIMULATED = DemoSkull()


def open_session(path: Path | str) -> Workbench:
    """Open a session file with virtual devices; the file is read, never changed.

    Args:
        path: Of the file.

    Raises:
        NotFoundError: there is no such file.
        SessionFormatError: not a session file, damaged, too large, or newer than this program.
    """
    return new_workbench(load_session(path))


def new_session(name: str = "notebook", *, seed: int = 0) -> Workbench:
    """Start a session with virtual devices.

    Args:
        name: Of the session.
        seed: Of the simulated patient, the placement of the devices and every noise.

    Raises:
        InvalidInputError: no name, or a seed out of range.
    """
    bench = new_workbench(Session(name=name))
    bench.dispatch(SetSeed(seed))
    return bench


def run_demo(
    seed: int = 0,
    skull: DemoSkull = SIMULATED,
    *,
    robot: str = "rx90",
    probe: str = "2.25MHz",
    world: WorldSettings = REALISTIC_WORLD,
    among: Stages = TO_MAPS,
    progress: StepProgress = unwatched,
) -> tuple[Session, dict[str, Any]]:
    """Carry out the complete procedure with virtual devices and judge it against ground truth.

    Args:
        seed: Seed of the patient, the placement and every noise.
        skull: What is scanned.
        robot: Name of the robot.
        probe: Name of the probe.
        world: How far patient and devices are from their stated values.
        among: The stages after set-up; those up to the maps, where nothing else is chosen.
        progress: Called with the step and the share of it that is done.

    Returns:
        The session and its figures, with the keys of ``docs/metrics.md``.

    Raises:
        RonaError: the set-up itself is invalid. What fails later is reported in the figures.
    """
    settings: list[Message] = []
    if robot != "rx90":
        settings.append(SetRobot(model=robot))
    if probe != ProbeSettings().name:
        settings.append(SetProbe(name=probe))
    if world != REALISTIC_WORLD:
        settings.append(SetWorld(**asdict(world)))
    return run_patient(seed, settings, skull, among=among, progress=progress)


def run_patient(
    seed: int,
    settings: Sequence[Message] = (),
    skull: DemoSkull = SIMULATED,
    *,
    among: Stages = TO_MAPS,
    progress: StepProgress = unwatched,
) -> tuple[Session, dict[str, Any]]:
    """Carry out the procedure as `run_demo`, with any commands of the set-up.

    Args:
        seed: Seed of the patient, the placement and every noise.
        settings: Commands that are sent before anything is recorded.
        skull: What is scanned.
        among: The stages after set-up.
        progress: Called with the step and the share of it that is done.

    Raises:
        RonaError: the set-up itself is invalid. What fails later is reported in the figures.
    """
    started = time.monotonic()
    bench = new_workbench(Session(name=f"demo seed {seed}"))
    try:
        _set_up(bench, seed, settings, skull, lambda share: progress("setup", share))
        bench.rig()
        progress("setup", 1.0)
        ending = run_procedure(bench, among, progress=progress)
        figures = _figures(bench, ending)
    finally:
        bench.close()
    setup = bench.session.setup
    head = {"seed": seed, "specimen": skull.name, "robot": setup.devices.robot.model}
    head["world"] = setup.world.profile
    return bench.session, {**head, **figures, "wall_s": time.monotonic() - started}


def planned_setup(seed: int, settings: Sequence[Message], skull: DemoSkull = SIMULATED) -> Setup:
    """Return the set-up that `run_patient` carries out the procedure with.

    Raises:
        RonaError: it is invalid.
    """
    bench = new_workbench(Session(name="set-up"))
    try:
        _set_up(bench, seed, settings, skull, lambda _share: None)
    finally:
        bench.close()
    return bench.session.setup


def _set_up(
    bench: Workbench, seed: int, settings: Sequence[Message], skull: DemoSkull, progress: Progress
) -> None:
    for setting in (SetSeed(seed), *settings):
        bench.dispatch(setting)
    _put_on_the_table(skull, bench, progress)


def _put_on_the_table(skull: DemoSkull, bench: Workbench, progress: Progress) -> None:
    radius_mm = 25.0 if skull.radius is None else float(skull.radius)
    region = SetRegion(skull.center, radius_mm)  # refuses a bad region before a file is read
    if skull.path is not None:
        progress(0.0)
        read = read_skull(
            skull.path,
            skull.inner,
            skull.threshold,
            skull.center,
            radius_mm,
            skull.label,
            progress=progress,
            cancel=never,
        )
        bench.store.dispatch(StoreSkull(read))
    elif skull.center is not None or skull.radius is not None:
        bench.dispatch(region)


def _figures(bench: Workbench, ending: Ending) -> dict[str, Any]:
    try:
        figures = bench.figures()
    except RonaError as error:
        figures = {}
        failed = ending.failed_step or "evaluation"
        why = ending.reason or str(error)
        ending = Ending(False, failed, why, ending.code or error.code, ending.left_out)
    figures["completed"] = ending.completed
    left = ending.left_out
    figures["second_pass_reason"] = left.get("tilts") or left.get("tilted")
    figures["references_reason"] = left.get("caliper")
    figures["bed_reason"] = ending.reason if ending.failed_step == "implant" else None
    figures["milling_reason"] = left.get("milling") or left.get("rehearsal")
    if not ending.completed:
        figures |= {"failed_step": ending.failed_step, "reason": ending.reason}
        figures["failure_code"] = ending.code
    return figures
