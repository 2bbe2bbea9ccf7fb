"""Pages of runs and sweeps for a browser: self-contained files, and a live page of a run in progress."""
