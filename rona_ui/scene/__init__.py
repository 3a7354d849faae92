"""What is drawn in 3D: one adapter per thing, in metres."""
