"""The maps, and what is planned in them, against ground truth."""
