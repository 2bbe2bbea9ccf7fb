"""Fast theory of floating or jointed bodies with power take-offs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from jaxsph.case.case import Case
from jaxsph.case.linear_bodies import SmallMotions, small_motions, why_no_motions
from jaxsph.case.settling import given_waves
from jaxsph.errors import CaseError
from jaxsph.problem.results import amplitude
from jaxsph.study.fast_theory import AbstractFastTheory, Fitted, Predictable
from jaxsph.waves.fast_bodies import BodyAdditions, BodySeries, Dampers, body_response

__all__ = ["BodyTheory"]

STIFFNESS = "stiffness of "
"""Beginning of the names of the links' stiffnesses among the parameters of `respond`."""
RESTING = 1e-4
"""Largest extension of a link at rest with which its stiffness does not displace the bodies, m or rad."""


@dataclass(frozen=True)
class BodyTheory(AbstractFastTheory):
    """Linear theory of a case's bodies, with quadratic drag and inertia of each free coordinate."""

    water: BodySeries
    small: SmallMotions
    """Bodies and links about their equilibrium."""
    dampers: Dampers
    """Forces of the links."""

    power: ClassVar[str] = "P_pto"

    @classmethod
    def why_not(cls, case):
        """See `AbstractFastTheory`."""
        if not case.has_take_off or case.chambers:
            return "a fast model of bodies needs a power take-off of a body, and no chamber"
        if reason := why_no_motions(cls.linear(case)):
            return f"{reason}: a fast model needs linear theory of the bodies"
        return ""

    @classmethod
    def linear(cls, case: Case) -> Case:
        """The case without the links' laws that linear theory does not cover; by default the case itself."""
        return case

    @classmethod
    def of(cls, case, omega):
        """See `AbstractFastTheory`."""
        small = small_motions(cls.linear(case))
        springs = _springs(case, small)
        water = BodySeries.of(small.section, small.bodies, springs, omega, case.fluid.rho0, case.g)
        return cls(case, water, small, _dampers(small, springs))

    @classmethod
    def restored(cls, case, series):
        """See `AbstractFastTheory`."""
        small = small_motions(cls.linear(case))
        springs = _springs(case, small)
        water = BodySeries.restored(series, small.section, small.bodies, springs, case.fluid.rho0, case.g)
        return cls(case, water, small, _dampers(small, springs))

    @classmethod
    def keys(cls, case):
        """See `AbstractFastTheory`."""
        found = {f"{case.body_key(body)}.pto.damping": name for body, name in case.pto_names.items()}
        found |= {f"link.{name}.damping": name for name, one in case.link.items() if one.damping}
        return found | cls.signed(case)

    @classmethod
    def signed(cls, case):
        """See `AbstractFastTheory`."""
        found = {f"{case.body_key(body)}.pto.spring": name for body, name in case.pto_names.items()}
        taken = (name for name, one in case.link.items() if one.take_off and not one.slack)
        found |= {f"link.{name}.stiffness": name for name in taken}
        return {key: STIFFNESS + name for key, name in found.items()}

    @classmethod
    def dampings(cls, case):
        """See `AbstractFastTheory`."""
        taken = {*case.pto_names.values(), *(name for name, one in case.link.items() if one.take_off)}
        signed = cls.signed(case)
        keys = {key: name for key, name in BodyTheory.keys(case).items() if key not in signed}
        return tuple(key for key, name in keys.items() if name in taken and case.value(key))

    @classmethod
    def moves(cls, case, parameter):
        """See `AbstractFastTheory`: numbers of a body's section, such as `body.disc.radius`."""
        if parameter in cls.keys(case):
            return False
        sections = tuple(f"{case.body_key(name)}." for name in case.every_body)
        return parameter.startswith(sections) and isinstance(case.value(parameter), int | float)

    @property
    def read(self):
        """See `AbstractFastTheory`."""
        return {"P_pto": "P_pto"} | {name: amplitude(name) for name in self.small.swings}

    @property
    def predictable(self):
        """See `AbstractFastTheory`."""
        found = {
            "xi": Predictable("ratio of absorbed to incident power", "", "P_pto"),
            "P_pto": Predictable("absorbed power", "W per metre of width", "P_pto"),
        }
        for name in self.small.swings:
            unit = "rad" if "pitch" in name else "m"
            found[name] = Predictable(f"amplitude of the {name.replace('_', ' ')}", unit, name)
        return found

    @property
    def additions(self):
        """See `AbstractFastTheory`."""
        n = len(self.small.bodies.mass)
        # the drag that doubles the damping by radiation in the waves of the case
        waves = given_waves(self.case)
        impedance, force = self.water.at(jnp.asarray(2.0 * np.pi / waves.period))
        radiated = np.asarray(jnp.real(jnp.diag(impedance)), float)
        rate = 0.5 * waves.height * np.abs(np.asarray(force)) / np.maximum(radiated, 1e-9)
        drag = tuple(float(a) for a in radiated / np.maximum(rate, 1e-9))
        none = (0.0,) * n
        return Fitted(
            BodyAdditions(drag, none),
            BodyAdditions(drag, (0.1,) * n),
            BodyAdditions(none, (-0.5,) * n),
            BodyAdditions((np.inf,) * n, (2.0,) * n),
        )

    def additions_from(self, given):
        """See `AbstractFastTheory`."""
        return BodyAdditions(*(tuple(map(float, given[name])) for name in BodyAdditions._fields))

    def _coordinates(self) -> list[str]:
        """Names of the free coordinates, with spaces."""
        found = []
        for k, one in enumerate(np.eye(len(self.small.bodies.mass))):
            same = (name for name, way in self.small.swings.items() if np.allclose(way, one))
            found.append(next(same, f"free motion {k + 1}").replace("_", " "))
        return found

    def found(self, added, error):
        """See `AbstractFastTheory`."""
        rows = []
        for k, name in enumerate(self._coordinates()):
            unit = "N m s2" if "pitch" in name else "N s2/m2"
            pairs = [(a[k], b[k]) for a, b in zip(added, error, strict=True)]
            (drag, its_error), (inertia, other_error) = pairs
            rows.append((f"drag in {name}", f"{drag:.3g} +- {its_error:.2g} {unit} per metre of width"))
            text = f"{inertia:.3g} +- {other_error:.2g} times the body's own"
            rows.append((f"additional inertia in {name}", text))
        return rows

    def respond(self, added, values, waves):
        """See `AbstractFastTheory`."""
        linear, stiffness = [], []
        for k, link in enumerate(self.small.links):
            if STIFFNESS + link in values:
                self.check_at_rest(link)
            linear.append(values.get(link, self.dampers.linear[k]))
            stiffness.append(values.get(STIFFNESS + link, self.water.springs[k]))
        changed = [jnp.stack([*map(jnp.asarray, each)]) for each in (linear, stiffness)]
        dampers = self.dampers._replace(linear=changed[0], stiffness=changed[1])
        return body_response(self.water, added, dampers, waves)

    def check_at_rest(self, link: str) -> None:
        """**Raises** CaseError if another stiffness of a link would move the bodies at rest."""
        if abs(extension := self.small.extensions[link]) > RESTING:
            raise CaseError(
                f"{link} has the extension {extension:.3g} at rest, so that another stiffness would move "
                "the bodies: place its ends such that it has no force at rest, or give `rest`"
            )

    def results(self, response):
        """See `AbstractFastTheory`."""
        found = {"xi": response.xi, "P_pto": response.P_pto}
        for name, way in self.small.swings.items():
            each = response.coordinates @ jnp.asarray(way, jnp.float32)
            found[name] = jnp.sqrt(jnp.sum(jnp.abs(each) ** 2, axis=-1))
        return found

    def within(self, values):
        """See `AbstractFastTheory`."""
        del values
        return True


def _springs(case: Case, small: SmallMotions) -> list[float]:
    """Stiffness of all links that a model can change; 0 for the others."""
    given = {name: case.value(key) for key, name in BodyTheory.signed(case).items()}
    return [given.get(STIFFNESS + link, 0.0) for link in small.links]


def _dampers(small: SmallMotions, springs: list[float]) -> Dampers:
    """Forces of links without friction, by their values at two rates."""
    at_one, at_two = (
        np.array([-float(one.force(np.array([v]))[0]) for one in small.bodies.dampings]) for v in (1.0, 2.0)
    )
    quadratic = 0.5 * (at_two - 2.0 * at_one)
    harvests = np.array([one.harvests for one in small.links.values()], float)
    given = (at_one - quadratic, quadratic, harvests, springs)
    return Dampers(*(jnp.asarray(a, jnp.float32) for a in given))
