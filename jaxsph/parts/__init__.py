"""Parts that exchange energy with the water: wavemakers, bodies, chambers, power take-offs, sponges."""
