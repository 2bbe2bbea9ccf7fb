"""Cases: validated sections, geometry rounded to the lattice, `build` and `assemble`, and reports."""
