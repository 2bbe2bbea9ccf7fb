"""Water waves: theory, their generation and absorption by a piston, and a linear oscillating water
column."""
