"""Virtual scene and virtual devices: the only ground truth."""
