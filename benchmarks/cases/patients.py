"""Sessions of virtual patients after the whole procedure, simulated and on real skulls."""

from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path

from benchmarks.metric import Progress
from benchmarks.suites.honesty.design import session_of
from benchmarks.suites.procedure.procedure import SKULLS, data_folder
from rona_core.app.procedure import Stages
from rona_core.compose import DemoSkull, run_demo
from rona_core.devices.world_settings import REALISTIC_WORLD
from rona_core.errors import RonaError
from rona_core.session.document import Session
from rona_core.session.files import load_session


def patients(
    progress: Progress,
    seeds: Iterable[int],
    skull_seeds: Iterable[int] = (),
    files: Iterable[Path] = (),
) -> Iterator[Session]:
    """Yield the sessions of the realistic world that came to their end.

    Args:
        progress: Told which one is made, and which was refused.
        seeds: Of simulated skulls, with tracker, robot and pointer by the balanced design.
        skull_seeds: Of each of two real skulls, where these are there.
        files: Sessions that were kept.
    """
    for seed in seeds:
        progress(f"simulated, seed {seed}")
        try:
            yield session_of(seed)
        except RonaError as error:
            progress(f"simulated, seed {seed}: refused: {error}")
    paths = [data_folder() / name for name in SKULLS]
    there = [DemoSkull(str(path)) for path in paths if path.is_file()]
    for skull, seed in product(there, skull_seeds):
        progress(f"{skull.name}, seed {seed}")
        yield run_demo(seed, skull, world=REALISTIC_WORLD)[0]
    yield from kept_sessions(progress, files)


def to_stage(
    progress: Progress, seeds: Iterable[int], files: Iterable[Path], among: Stages
) -> Iterator[Session]:
    """Yield a session of each seed after these stages, then those that were kept."""
    for seed in seeds:
        progress(f"seed {seed}")
        yield run_demo(seed, among=among)[0]
    yield from kept_sessions(progress, files)


def kept_sessions(progress: Progress, files: Iterable[Path]) -> Iterator[Session]:
    """Yield the sessions of files."""
    for path in files:
        progress(path.name)
        yield load_session(path)
