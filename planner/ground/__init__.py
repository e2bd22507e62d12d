"""Where robots may be: shapes, grids of them, any-angle shortest ways, distances."""
