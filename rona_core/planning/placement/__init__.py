"""Where in the mapped bone an implant's bed may lie, and how sure that is."""
