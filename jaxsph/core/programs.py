"""Compiled programs that JAX keeps in memory."""

from __future__ import annotations

import gc
from pathlib import Path

import jax

MOST = 0.5
"""Share of the allowed number of memory maps above which compiled programs are forgotten (-)."""
MAPS, LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
"""Files of Linux with the memory maps of this process, and with the number of maps that it may have."""


def forget_programs() -> None:
    """Forgets all compiled programs if they take so many memory maps that another program may not fit.

    A program compiled for the CPU takes 1500 to 6000 memory maps and keeps them. Linux allows a process 65530
    by default, and Python ends without an exception if the compiler gets no more. Programs that are needed
    again are read from the cache on disk. On other systems this function does nothing.
    """
    try:
        limit = int(LIMIT.read_text(encoding="ascii"))
        with MAPS.open("rb") as maps:
            count = sum(1 for _ in maps)
    except (OSError, ValueError):
        return
    if count > MOST * limit:
        jax.clear_caches()
        gc.collect()
