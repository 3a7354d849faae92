"""Skull import: a mask, a CT or a mesh that was uploaded becomes the specimen."""

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.messages.outcomes import StoreSkull
from rona_core.app.steps.setup.messages import StartSkullImport
from rona_core.errors import NotFoundError
from rona_core.session.document import Session


def import_uploaded_skull(
    activity: StartSkullImport, session: Session, context: ActivityContext
) -> tuple[StoreSkull]:
    """Read a skull from uploaded files.

    Raises:
        NotFoundError: one was not uploaded.
    """
    for name in (activity.file, activity.inner_file):
        if name and not (context.uploads / name).is_file():
            raise NotFoundError(f"there is no uploaded file {name!r}: upload it first")
    inner = activity.inner_file
    skull = context.run(
        context.import_skull,
        str(context.uploads / activity.file),
        str(context.uploads / inner) if inner else None,
        activity.threshold,
        activity.center_mesh_mm,
        activity.radius_mm,
    )
    return (StoreSkull(skull),)
