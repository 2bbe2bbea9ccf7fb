"""jaxsph: a differentiable SPH solver for wave energy converters, in JAX.

Names are imported when they are first used, so that `jaxsph --help` need not wait for JAX.
"""

import importlib
from typing import Any

_ROOMS = {
    "case": ("Case", "assemble", "build", "built_in_cases", "check", "load_case", "make_probes"),
    "linear": (
        "ChamberGeometry",
        "LinearOWC",
        "RadiationAndScattering",
        "linear_check",
        "linear_owc",
        "linear_response",
        "radiation_and_scattering",
    ),
    "boundaries": ("Box", "FreeSlip", "Ghosts", "NoSlip"),
    "errors": ("CaseError", "DerivativeError", "FileError", "JaxsphError", "SimulationError"),
    "probes": ("ChamberProbe", "EnergyProbe", "PressureProbe", "WaveGauge"),
    "design": ("Sweep", "read_sweep", "sweep"),
    "gradients": ("Derivative", "Ensemble", "Exact", "Filtered", "Maximum", "derivative", "maximise"),
    "driver": ("march", "restore", "resume", "run", "simulate"),
    "state": ("Model", "Solution", "State"),
    "tangents": ("TangentFilter",),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'jaxsph' has no attribute {name!r}")
    return getattr(importlib.import_module(f"jaxsph.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
