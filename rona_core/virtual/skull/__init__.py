"""The simulated skull: closed-form boundaries, and the splines that make them fast."""
