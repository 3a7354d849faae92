"""Step 10: where the bed of an implant lies in the mapped bone, and how it would be milled."""
