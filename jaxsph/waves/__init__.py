"""Water waves: theory, their generation and absorption by a piston, and linear theory of oscillating
water columns and floating bodies."""
