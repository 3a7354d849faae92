"""Files of the boundary maps that other programs read; all of them in ``base``."""
