"""Cases: their validated sections, their geometry on the lattice, `build`, `assemble`, and reports."""
