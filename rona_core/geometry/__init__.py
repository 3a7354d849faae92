"""Rigid poses, fits of simple shapes, and the 5D path: the words the other packages share."""
