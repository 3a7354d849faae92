"""Planning in the maps of the bone: implants, their bed, where it can be, and how it is milled."""
