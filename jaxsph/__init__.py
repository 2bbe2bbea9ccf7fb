"""jaxsph: a differentiable SPH solver for wave energy converters, in JAX.

Public names are imported when they are first used, so that `jaxsph --help` does not wait for JAX.
"""

import importlib
import sys
import types
from typing import Any

from jaxsph.start import prepare_jax

_ROOMS = {
    "analysis.coefficients": ("Coefficients", "Mode"),
    "case.assemble": ("assemble",),
    "case.build": ("build",),
    "case.case": ("Case",),
    "case.coarse": ("coarsen",),
    "case.files": ("built_in_cases", "load_case"),
    "case.held": ("Forcing",),
    "case.initial": ("still_water",),
    "case.linear": ("incident_power", "linear_check", "linear_owc", "linear_sea"),
    "case.linear_bodies": ("LinearMotions", "linear_motions"),
    "case.probes": ("make_probes",),
    "case.report": ("check",),
    "core.design": ("least_stress",),
    "core.kernels": ("AbstractKernel", "Gaussian", "Polynomial", "Semicircle", "WendlandC2"),
    "core.lattice": ("LatticeStress", "lattice_stress", "surface_stiffness"),
    "errors": ("CaseError", "DerivativeError", "FileError", "JaxsphError", "SimulationError"),
    "model.air": ("AbstractPTO",),
    "model.forces": ("AbstractConservativeForce", "AbstractForce", "CentralForce"),
    "model.interfaces": ("AbstractChamber", "AbstractDamper", "AbstractScheme", "Model"),
    "model.links": ("AbstractEnds", "AbstractLaw", "Link"),
    "model.meaning": ("Entry", "Label", "Oscillation", "Reading"),
    "model.part": ("AbstractPart", "Sampled"),
    "model.probe": ("AbstractProbe",),
    "model.solution": ("Solution",),
    "model.solids": ("AbstractJoint",),
    "model.state": ("State",),
    "model.tangents": ("TangentFilter",),
    "model.viscosity": (
        "AbstractViscosity",
        "ArtificialViscosity",
        "LaplacianViscosity",
        "PhysicalViscosity",
    ),
    "output.coefficient_files": ("AbstractCoefficientFile", "BEMIOFile", "CapytaineFile"),
    "output.dataset": ("on_grid", "read"),
    "parts.air": ("IncompressibleAir", "IsentropicAir"),
    "parts.body": ("RigidBody",),
    "parts.chamber": ("BodyForceGrip", "Chamber", "SurfaceGrip"),
    "parts.duct": ("Duct",),
    "parts.frames": ("BodyFrame", "TankFrame"),
    "parts.driven": ("AbstractPath", "DrivenSolid"),
    "parts.catenary": ("GroundedCatenary", "HangingCatenary"),
    "parts.joint": ("PlanarJoint", "SpatialJoint"),
    "parts.line": ("Bed", "LumpedLine", "Morison"),
    "parts.moorings": ("FromAnchor", "Mooring", "QuasiStatic"),
    "parts.links": (
        "AlongJoint",
        "BetweenPoints",
        "Controlled",
        "Damper",
        "EndStops",
        "Friction",
        "HydraulicTakeOff",
        "Latch",
        "Laws",
        "Rope",
        "Spring",
    ),
    "parts.paddle": ("AbsorbingMotion", "AbstractGivenMotion", "Paddle", "WaveMotion"),
    "parts.paths": ("HarmonicPath", "SampledPath"),
    "parts.pto": (
        "AbstractTurbine",
        "CharacteristicCurve",
        "ClosedPTO",
        "Constriction",
        "ControlledPTO",
        "LinearTurbine",
        "PneumaticPTO",
        "PrescribedPressure",
        "ReliefValve",
        "orifice_damping",
    ),
    "parts.relaxation": ("BasinZone", "FlowMotion", "RelaxationZone"),
    "parts.segmented": ("SegmentedPaddle",),
    "parts.sponge": ("Sponge", "SpongeLayer"),
    "probes.default": ("default_probes",),
    "probes.energy": ("EnergyProbe",),
    "probes.gauges": ("WaveGauge",),
    "probes.noise": ("NoiseProbe",),
    "probes.parts": ("PartProbe",),
    "probes.sensors": ("PressureProbe",),
    "problem.problem": ("Problem",),
    "problem.program": ("Program",),
    "problem.record": ("AbstractAveraging", "Record", "Result", "Window"),
    "report.froude": ("full_scale",),
    "report.page": ("report",),
    "report.tables": ("export",),
    "report.watch": ("Watch",),
    "run.duration": ("Duration", "duration"),
    "run.host": ("march", "restore", "resume", "run"),
    "run.profile": ("Profile", "profile"),
    "run.simulate": ("simulate",),
    "schemes.incompressible": ("ISPH",),
    "schemes.weakly_compressible": ("DeltaSPH",),
    "solids.box": ("Box", "FreeSlip", "NoSlip", "Platform", "WallPlate"),
    "solids.composed": ("Difference", "Placed", "Union"),
    "solids.filling": ("DummyParticles", "MirrorImages", "MirrorNodes"),
    "solids.mesh": ("Mesh",),
    "solids.plate": ("Plate",),
    "solids.shapes": ("AbstractShape", "Block", "Disc", "Polygon"),
    "solids.swept": ("Extrusion", "Revolution"),
    "solids.volumes": ("Capsule", "Cylinder", "Sphere"),
    "solids.walls": ("Ghosts",),
    "study.base": ("Derivative",),
    "study.calibrated": ("Calibrated",),
    "study.coefficients": ("coefficients",),
    "study.derivative": ("derivative",),
    "study.ensemble": ("Ensemble",),
    "study.fast_model": ("FastModel", "calibrate"),
    "study.matrix": ("PowerMatrix", "power_matrix"),
    "study.optimise": ("Maximum", "best_parameters", "maximise"),
    "study.over_seas": ("OverSeas",),
    "study.scatter": ("ScatterTable",),
    "study.search": ("PerCost", "search"),
    "study.spacing_error": ("WithError", "errors_of_members", "members_at", "with_error"),
    "study.sweep": ("Sweep", "read_sweep", "sweep"),
    "study.tangents": ("Exact", "Filtered"),
    "waves.fields": ("DirectionalSea", "LongCrestedWaves"),
    "waves.linear_owc": ("LinearAir", "LinearOWC", "linear_response"),
    "waves.linear_sea": ("LinearSea", "integrated_sea_response", "linear_sea_response"),
    "waves.radiation": ("ChamberGeometry", "RadiationAndScattering", "radiation_and_scattering"),
    "waves.regular": ("RegularWaves", "SecondOrderPiston"),
    "waves.seas": ("Sea",),
    "waves.spectra": ("JONSWAP", "Bretschneider", "draw_group", "draw_sea"),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'jaxsph' has no attribute {name!r}")
    return getattr(importlib.import_module(f"jaxsph.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__


class _Facade(types.ModuleType):
    """Module whose public names take precedence over subpackages: `js.run` is the function `run`."""

    def __setattr__(self, name: str, value: Any) -> None:
        # importing a subpackage binds its name in the package, which would hide the function of that name
        if not (name in _HOME and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Facade

prepare_jax()
