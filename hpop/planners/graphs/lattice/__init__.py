"""SE(2) lattice: a graph of positions on a grid with headings, connected by steps and by motions in place."""
