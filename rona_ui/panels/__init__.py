"""What stands in the docks of the window: steps, fields, quality, plots."""
