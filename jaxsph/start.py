"""Settings that JAX needs before it is imported: the folder of its compilation cache, and its log level."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import sys
from pathlib import Path

import platformdirs

MOST = 2**30
"""Size of the compilation cache (bytes) above which the oldest programs are removed."""
ENOUGH = 0.8
"""Fraction of `MOST` to which a larger compilation cache is reduced (-)."""


def prepare_jax() -> None:
    """Turns on JAX's compilation cache, and limits the compiler's log to fatal errors.

    All compiled programs, even those that compile quickly, are stored in the user's cache folder for later
    starts. The environment variable JAX_COMPILATION_CACHE_DIR sets another folder, and
    JAX_ENABLE_COMPILATION_CACHE=0 turns the cache off. A folder that a program has already set in JAX, and an
    existing TF_CPP_MIN_LOG_LEVEL, are kept.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = Path(platformdirs.user_cache_dir("jaxsph", appauthor=False)) / "compiled" / _processor()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        return  # the folder is not writable, and JAX would warn about every program
    settings = {
        "jax_compilation_cache_dir": str(folder),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
    }
    if jax := sys.modules.get("jax"):
        if jax.config.jax_compilation_cache_dir is not None:
            return
        for name, value in settings.items():
            jax.config.update(name, value)
    # the worker processes of a sweep inherit the environment
    os.environ |= {name.upper(): str(value) for name, value in settings.items()}
    remove_oldest(folder, MOST)


def remove_oldest(folder: Path, most: int) -> None:
    """Removes a folder's oldest files if all its files together exceed `most` bytes."""
    with contextlib.suppress(OSError):  # another process may remove the same files
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
    """Hash of the processor type; programs for another type may use instructions that this type lacks."""
    described = f"{platform.machine()} {platform.processor()}"
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        wanted = ("model name", "flags", "CPU part", "Features")
        described += "".join(sorted({line for line in lines if line.startswith(wanted)}))
    return hashlib.sha256(described.encode()).hexdigest()[:12]
