"""Compiled programs that JAX keeps in memory and on disk."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

OPTIONS = {"xla_disable_hlo_passes": "dot-library-rewriter"}
"""Compiler options of the steps of a run: with sums by XLA's library of kernels for CPUs a step of the
built-in OWC takes 5 % longer."""

MOST = 0.5
"""Fraction of the allowed number of memory maps above which compiled programs are discarded (-)."""
MAPS, LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
"""Linux files with the memory maps of this process, and with the largest number of maps of a process."""


def forget_programs() -> None:
    """Discards all compiled programs if the process has so many memory maps that another program may not fit.

    A program compiled for the CPU occupies 1500 to 6000 memory maps until it is discarded. Linux allows a
    process 65530 maps by default. If the compiler needs more, Python terminates without an exception.
    Programs that are needed again are read from the cache on disk. On other systems this function does
    nothing.
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


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Context in which programs are compiled although the cache on disk contains them."""
    on = jax.config.values["jax_enable_compilation_cache"]
    try:
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()  # JAX looks at the setting only once
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", on)
        compilation_cache.reset_cache()


def program_folder() -> Path | None:
    """Folder of JAX's cache of compiled programs; None if the cache is off."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    return Path(folder) if folder and jax.config.values["jax_enable_compilation_cache"] else None
