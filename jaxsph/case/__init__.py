"""Cases: sections and their validation, geometry on the lattice, `build` and `assemble`, reports."""
