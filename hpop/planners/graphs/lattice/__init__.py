"""The SE(2) lattice: grid positions, headings, steps and motions in place."""
