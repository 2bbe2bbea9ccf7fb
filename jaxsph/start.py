"""JAX's settings that have to be made before it is imported: where it keeps what it compiles, and its log."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import sys
from pathlib import Path

import platformdirs

MOST = 2**30
"""Size (bytes) of the kept programs beyond which the oldest are removed."""
ENOUGH = 0.8
"""Share of it that stays then."""


def prepare_jax() -> None:
    """Makes JAX keep what it compiles for the next start, and its compiler log fatal errors only.

    It is kept in the user's cache folder, whatever time it took to compile. JAX_COMPILATION_CACHE_DIR names
    another folder and JAX_ENABLE_COMPILATION_CACHE=0 turns it off; variables of the environment that are set,
    and a folder that a program has given JAX itself, stay as they are.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = Path(platformdirs.user_cache_dir("jaxsph", appauthor=False)) / "compiled" / _processor()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        return  # nothing can be kept, and JAX would say so for each program
    settings = {
        "jax_compilation_cache_dir": str(folder),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
    }
    if jax := sys.modules.get("jax"):
        if jax.config.jax_compilation_cache_dir is not None:
            return
        for name, value in settings.items():
            jax.config.update(name, value)
    # the processes of a sweep inherit the environment
    os.environ |= {name.upper(): str(value) for name, value in settings.items()}
    remove_oldest(folder, MOST)


def remove_oldest(folder: Path, most: int) -> None:
    """Removes the oldest files of a folder, if all of them take more than `most` bytes."""
    with contextlib.suppress(OSError):  # another process removes them too
        files = sorted(
            ((entry.stat(), entry.path) for entry in os.scandir(folder)), key=lambda file: file[0].st_mtime
        )
        size = sum(stat.st_size for stat, _ in files)
        if size <= most:
            return
        for stat, path in files:
            if size <= ENOUGH * most:
                break
            os.unlink(path)
            size -= stat.st_size


def _processor() -> str:
    """Name of the processor's kind: a program compiled for another may use instructions that it lacks."""
    described = f"{platform.machine()} {platform.processor()}"
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        wanted = ("model name", "flags", "CPU part", "Features")
        described += "".join(sorted({line for line in lines if line.startswith(wanted)}))
    return hashlib.sha256(described.encode()).hexdigest()[:12]
