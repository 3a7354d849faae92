"""The virtual scene and the devices that look at it: the only ground truth there is."""
