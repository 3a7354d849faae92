"""3D scene: one layer per kind of object, drawn from snapshots."""
