"""Files of added mass, damping and excitation, in Capytaine's layout (netCDF) or WEC-Sim's BEMIO (HDF5)."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.coefficients import MOTIONS, BodyAtRest, Coefficients, Mode
from jaxsph.errors import CaseError
from jaxsph.output.dataset import wanted
from jaxsph.output.hdf5 import put_file, replace_file, tell_write_errors, version

PER_WIDTH = "two-dimensional: all forces, masses and stiffnesses are per metre of width"
"""Remark in every file."""
SPREAD = "standard deviation from period to period of the run; discretisation errors are not included"
"""Description of the coefficients' spreads, stored in every file."""


class AbstractCoefficientFile(abc.ABC):
    """File of coefficients in the layout of another program."""

    path: Path

    def __init__(self, path: str | Path) -> None:
        """Stores the path of the file, which need not exist yet."""
        self.path = Path(path)

    @abc.abstractmethod
    def check(self, modes: Sequence[Mode], bodies: Mapping[str, BodyAtRest]) -> None:
        """**Raises** CaseError if the layout cannot store the coefficients of these modes, or FileError if a
        library is missing."""

    @abc.abstractmethod
    def write(self, found: Coefficients) -> None:
        """Writes the coefficients, and replaces an existing file. **Raises** FileError if this fails."""


def file_at(path: str | Path) -> AbstractCoefficientFile:
    """File of coefficients in the layout that the suffix selects. **Raises** CaseError for other suffixes."""
    found = {".nc": CapytaineFile, ".h5": BEMIOFile}.get(Path(path).suffix)
    if found is None:
        raise CaseError(
            f"{path}: the name must end in .nc (netCDF in Capytaine's layout) or in .h5 (HDF5 in the layout "
            "of WEC-Sim's BEMIO)"
        )
    return found(path)


class CapytaineFile(AbstractCoefficientFile):
    """netCDF file in the layout of Capytaine's datasets.

    The dimensions are omega, radiating_dof, influenced_dof, wave_direction and, for complex values, complex.
    In this layout motions and forces oscillate as exp(-i omega t), so that the excitation is the conjugate of
    `Coefficients.X`. Positions are measured from the reference position in the still water surface.
    """

    def check(self, modes, bodies):
        """See `AbstractCoefficientFile`."""
        with wanted("a file of coefficients in netCDF", "xarray and h5netcdf"):
            import h5netcdf  # noqa: F401
            import xarray  # noqa: F401

    def write(self, found):
        """See `AbstractCoefficientFile`."""
        self.check(found.modes, found.bodies)
        import xarray

        both, one = ("influenced_dof", "radiating_dof"), ("omega", "wave_direction", "influenced_dof")
        X = found.X[:, None, :]
        variables = {
            "added_mass": (("omega", *both), found.A, "Added mass"),
            "radiation_damping": (("omega", *both), found.B, "Radiation damping, losses included"),
            "excitation_force": (("complex", *one), np.stack([np.real(X), -np.imag(X)]), "Excitation force"),
            "inertia_matrix": (both, found.M, "Inertia matrix"),
            "hydrostatic_stiffness": (both, found.C, "Hydrostatic stiffness, weight included"),
            "added_mass_spread": (("omega", *both), found.A_spread, SPREAD),
            "radiation_damping_spread": (("omega", *both), found.B_spread, SPREAD),
            "excitation_force_spread": (one, found.X_spread[:, None, :], SPREAD),
            "echo": (
                ("omega", "radiating_dof"),
                found.echo,
                "ratio of the force of waves that return from the paddle (subtracted) to the radiation force",
            ),
        }
        if found.linear is not None:
            Y = found.linear.X[:, None, :]
            text = "by linear theory of inviscid water"
            variables |= {
                "added_mass_linear": (("omega", *both), found.linear.A, text),
                "radiation_damping_linear": (("omega", *both), found.linear.B, text),
                "excitation_force_linear": (("complex", *one), np.stack([np.real(Y), -np.imag(Y)]), text),
            }
        names = _names(found.modes)
        dataset = xarray.Dataset(
            {name: (dims, values, {"long_name": text}) for name, (dims, values, text) in variables.items()},
            {
                "omega": ("omega", found.omega, {"long_name": "Angular frequency", "units": "rad/s"}),
                "period": ("omega", 2.0 * np.pi / found.omega, {"long_name": "Period", "units": "s"}),
                "wave_direction": ("wave_direction", [0.0], {"long_name": "Wave direction", "units": "rad"}),
                "influenced_dof": names,
                "radiating_dof": names,
                "complex": ["re", "im"],
                "rho": found.rho,
                "g": found.g,
                "water_depth": found.depth,
            },
            self._about(found),
        )
        with tell_write_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            put_file(self.path, bytes(dataset.to_netcdf(engine="h5netcdf")))

    def _about(self, found: Coefficients) -> dict[str, str | float]:
        """Attributes of the file."""
        at = [
            f"{name} at x = {body.pivot[0]:g} m, z = {body.pivot[1]:g} m"
            for name, body in found.bodies.items()
        ]
        return {
            "title": f"Hydrodynamic coefficients of the case {found.name}",
            "source": f"jaxsph {version()}, smoothed particle hydrodynamics",
            "units": PER_WIDTH,
            "convention": "exp(-i omega t); wave crest at x = 0 at t = 0; z = 0 at the still water level",
            "rotation_centers": "; ".join(at),
            "x_from_paddle": found.x,
            "failures": "\n".join(f"{run}: {text.splitlines()[0]}" for run, text in found.failures.items()),
        }


def _names(modes: Sequence[Mode]) -> list[str]:
    """Capytaine's names of the modes: "Heave", or "buoy__Heave" if there are several bodies."""
    several = len({mode.body for mode in modes}) > 1
    return [(f"{mode.body}__" if several else "") + mode.motion.capitalize() for mode in modes]


SIX = {"surge": 0, "heave": 2, "pitch": 4}
"""Indices of the motions among the six degrees of freedom of a body in three dimensions."""


class BEMIOFile(AbstractCoefficientFile):
    """HDF5 file in the layout of BEMIO, which WEC-Sim reads.

    With N bodies, every body has matrices of 6 x 6 N elements, which are zero for motions that do not exist
    in two dimensions or were not requested. Added mass is divided by rho, damping by rho omega, excitation
    and stiffness by rho g. Motions oscillate as exp(i omega t). WEC-Sim takes moments about the centre of
    mass, so the coefficients are transformed from the pivot to the centre of mass. The added mass at infinite
    frequency is NaN, and the impulse responses are left out, because the coefficients at a few wave
    periods do not determine them. A simulation in regular waves does not need this added mass.
    """

    def check(self, modes, bodies):
        """See `AbstractCoefficientFile`."""
        for name, body in bodies.items():
            has = {mode.motion for mode in modes if mode.body == name}
            off = np.hypot(*np.subtract(body.pivot, body.centre)) > 1e-9
            if off and "pitch" in has and has != set(MOTIONS):
                raise CaseError(
                    f"{self.path}: WEC-Sim takes moments about the centre of mass, but the pivot of {name} "
                    f"is another point; compute all of surge, heave and pitch of {name}, or give a file name "
                    "that ends in .nc"
                )

    def write(self, found):
        """See `AbstractCoefficientFile`."""
        self.check(found.modes, found.bodies)
        with tell_write_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(self.path, "w", sealed=False) as file:
            file.attrs.update(
                units=PER_WIDTH, x_from_paddle=found.x, modes=[" of ".join(m[::-1]) for m in found.modes]
            )
            file["bem_data/code"] = f"jaxsph {version()}"
            _put(file, "simulation_parameters/scaled", 0.0, "", "")
            _put(file, "simulation_parameters/g", found.g, "Gravitational acceleration", "m/s^2")
            _put(file, "simulation_parameters/rho", found.rho, "Water density", "kg/m^3")
            _put(file, "simulation_parameters/water_depth", found.depth, "Water depth", "m")
            _put(file, "simulation_parameters/wave_dir", 0.0, "Wave direction", "deg")
            columns = found.omega[:, None], 2.0 * np.pi / found.omega[:, None]
            _put(file, "simulation_parameters/w", columns[0], "Wave frequencies", "rad/s")
            _put(file, "simulation_parameters/T", columns[1], "Wave periods", "s")
            values = _in_six(found)
            for index, name in enumerate(found.bodies):
                self._body(file.create_group(f"body{index + 1}"), index, name, found, values)

    def _body(
        self,
        group: h5py.Group,
        index: int,
        name: str,
        found: Coefficients,
        values: Mapping[str, NDArray],
    ) -> None:
        """Writes one body; `values`: arrays over the six motions of all bodies, from `_in_six`."""
        body, rows = found.bodies[name], slice(6 * index, 6 * index + 6)
        group["properties/name"] = name
        for key, value, text, unit in (
            ("body_number", index + 1.0, "Number of rigid body", ""),
            ("cb", [[body.buoyancy[0]], [0.0], [body.buoyancy[1]]], "Center of buoyancy", "m"),
            ("cg", [[body.centre[0]], [0.0], [body.centre[1]]], "Center of gravity", "m"),
            ("disp_vol", body.area, "Displaced volume per metre of width", "m^2"),
            ("dof", 6.0, "Degrees of freedom", ""),
            ("dof_start", 6.0 * index + 1.0, "First degree of freedom", ""),
            ("dof_end", 6.0 * index + 6.0, "Last degree of freedom", ""),
        ):
            _put(group, f"properties/{key}", value, text, unit)
        X = values["X"][rows, None, :] / (found.rho * found.g)
        A, B = (values[key][rows] / found.rho for key in ("A", "B"))
        unknown = np.where(np.any(A != 0.0, axis=2), np.nan, 0.0)
        for key, value, text in (
            ("linear_restoring_stiffness", values["C"][rows, rows] / (found.rho * found.g), "over rho g"),
            ("added_mass/all", A, "Added mass over rho"),
            ("added_mass/inf_freq", unknown, "Added mass at infinite frequency: not computed"),
            ("radiation_damping/all", B / found.omega, "Radiation damping over rho omega"),
            ("excitation/re", X.real, "Real part of the excitation force over rho g"),
            ("excitation/im", X.imag, "Imaginary part of the excitation force over rho g"),
            ("excitation/mag", np.abs(X), "Magnitude of the excitation force over rho g"),
            ("excitation/phase", np.angle(X), "Phase of the excitation force, rad"),
            ("added_mass/spread", values["A_spread"][rows] / found.rho, SPREAD),
            ("radiation_damping/spread", values["B_spread"][rows] / found.rho / found.omega, SPREAD),
        ):
            _put(group, f"hydro_coeffs/{key}", value, text, "per metre of width")


def _in_six(found: Coefficients) -> dict[str, NDArray]:
    """Coefficients for the six motions of each body, about its centre of mass; the last axis is frequency.

    A motion xi of the centre of mass moves the pivot by T xi, where T contains the pivot's position r
    relative to the centre of mass. Matrices become T^T A T. The spreads are not transformed: they refer to
    the pivot.
    """
    names, n = list(found.bodies), len(found.modes)
    place = [6 * names.index(mode.body) + SIX[mode.motion] for mode in found.modes]
    T = np.eye(n)
    for j, pitch in enumerate(found.modes):
        if pitch.motion != "pitch":
            continue
        body = found.bodies[pitch.body]
        r = np.subtract(body.pivot, body.centre)
        for i, mode in enumerate(found.modes):
            if mode.body == pitch.body and mode.motion != "pitch":
                T[i, j] = r[1] if mode.motion == "surge" else -r[0]
    size, at = 6 * len(names), np.ix_(place, place)
    moved = {
        "A": T.T @ found.A @ T,
        "B": T.T @ found.B @ T,
        "A_spread": found.A_spread,
        "B_spread": found.B_spread,
    }
    values: dict[str, NDArray] = {}
    for key, over in moved.items():
        values[key] = np.zeros((size, size, len(found.omega)))
        values[key][at] = np.moveaxis(over, 0, -1)
    values["C"] = np.zeros((size, size))
    values["C"][at] = T.T @ found.C @ T
    values["X"] = np.zeros((size, len(found.omega)), complex)
    values["X"][place] = T.T @ found.X.T
    return values


def _put(group: h5py.Group, name: str, value: ArrayLike, description: str, units: str) -> None:
    """Writes a number (as a 1 x 1 array) or an array, with its description and units."""
    data = group.create_dataset(name, data=np.atleast_2d(np.asarray(value, float)))
    data.attrs["description"], data.attrs["units"] = description, units
