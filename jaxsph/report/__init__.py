"""Pages of runs and sweeps for a browser: a file with everything in it, and a page of a run that goes on."""
