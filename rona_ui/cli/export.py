"""``rona export``: maps and implant bed of a session as files for other programs."""

import sys
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.export import FILES
from rona_core.errors import storing
from rona_core.session.files import load_session


def run(wanted: Any) -> int:
    """Write the files, and say where they are; nothing is written if one cannot be made."""
    session = load_session(wanted.file)
    names = wanted.only or [name for name, *_ in FILES]
    made = {name: REGISTRY.export(session, name) for name in names}
    for name, data in made.items():
        path = wanted.out / name
        with storing(path):
            wanted.out.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        sys.stdout.write(f"{path}  {len(data) / 1024:.0f} kB\n")
    return 0
