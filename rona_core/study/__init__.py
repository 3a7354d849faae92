"""Studies: the procedure on many virtual patients, drawn by a plan, and what they say together."""
