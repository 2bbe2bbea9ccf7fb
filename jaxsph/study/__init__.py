"""Studies over many runs: sweeps, slopes over a number of a case, searches for the best values."""
