"""Whether what the program says of its own errors holds."""
