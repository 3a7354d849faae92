"""``rona export``: what a session holds as files for other programs."""

import sys
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.errors import RonaError, storing
from rona_core.session.files import load_session

NOTHING_WRITTEN = 3


def run(wanted: Any) -> int:
    """Write the files, and say where they are.

    Of files by name nothing is written if one cannot be made; of a whole kind, those that cannot
    are said.
    """
    session = load_session(wanted.file)
    made = {name: REGISTRY.export(session, name) for name in wanted.only}
    if not wanted.kinds and not made:  # the maps, all of them or none
        maps = [one.name for one in REGISTRY.exports.values() if one.kind == "maps"]
        made = {name: REGISTRY.export(session, name) for name in maps}
    for one in REGISTRY.exports.values():
        if one.kind in wanted.kinds:
            try:
                made[one.name] = one.make(session)
            except RonaError as error:
                sys.stdout.write(f"{one.name} is not written: {error}\n")
    for name, data in made.items():
        path = wanted.out / name
        with storing(path):
            wanted.out.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        sys.stdout.write(f"{path}  {len(data) / 1024:.0f} kB\n")
    return 0 if made else NOTHING_WRITTEN
