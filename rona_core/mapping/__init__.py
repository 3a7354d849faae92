"""Maps of the outer and inner boundary, and their fusion with the pointer cloud."""
