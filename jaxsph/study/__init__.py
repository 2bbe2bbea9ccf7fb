"""Studies with many runs: sweeps, slopes with respect to a parameter, searches for the best values."""
