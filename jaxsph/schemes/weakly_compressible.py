"""Weakly compressible delta-SPH (Zhu et al. 2020, section 2; Antuono et al. 2012).

Equation numbers refer to Zhu et al. unless another source is named.
"""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns, dot
from jaxsph.core.kernels import AbstractKernel, Gaussian
from jaxsph.core.pairs import (
    Pair,
    Period,
    Smoothing,
    symmetric_inverse,
    symmetric_product,
    trace_upper,
    uncorrected,
)
from jaxsph.core.parts import Part
from jaxsph.core.slabs import Sources
from jaxsph.model import laws
from jaxsph.model.background import Background
from jaxsph.model.interfaces import AbstractGrip, Model
from jaxsph.model.regularisation import (
    HYPERVISCOSITY,
    SEPARATION,
    Regularisation,
    regularisations,
)
from jaxsph.model.shifting import Shifting
from jaxsph.model.state import Particles, State, Tables
from jaxsph.model.viscosity import AbstractViscosity, PhysicalViscosity
from jaxsph.parts.chamber import SurfaceGrip
from jaxsph.schemes.integrators import AbstractIntegrator, AbstractRateScheme, Rates, SymplecticEuler
from jaxsph.schemes.step import GhostFields, at_rest
from jaxsph.schemes.time_step import stable_dt


class DeltaSPH(AbstractRateScheme):
    """Weakly compressible delta-SPH scheme: Eq. 17 with its closures, advanced by a time integrator."""

    too_fast: ClassVar[str] = "a particle is faster than a third of the speed of sound"
    grip: ClassVar[AbstractGrip] = SurfaceGrip()
    smoothing: Smoothing
    """Kernel, smoothing length and periodic axes."""
    c0: Scalar
    """Numerical speed of sound, m/s."""
    rho0: Scalar
    """Density of water at zero gauge pressure, kg/m3."""
    delta: Scalar
    """Coefficient of the density diffusion (-)."""
    viscosity: AbstractViscosity
    """Law of the viscous force."""
    integrator: AbstractIntegrator
    """Time integrator."""
    background: tuple[Background, ...] = ()
    """Hydrostatic pressures that are subtracted in the pair sums near thin walls."""
    regularisation: tuple[Regularisation, ...] = eqx.field(default=(), kw_only=True)
    """Regularisation of the particles: empty, or one entry."""
    shifting: tuple[Shifting, ...] = eqx.field(default=(), kw_only=True)
    """Particle shifting in addition to the drift: empty, or one entry."""

    @classmethod
    def of(
        cls,
        dx: float,
        c0: float,
        *,
        rho0: float = 1000.0,
        delta: float = 0.1,
        viscosity: AbstractViscosity | None = None,
        kernel: AbstractKernel | None = None,
        h_over_dx: float = 1.2,
        integrator: AbstractIntegrator | None = None,
        period: Period = (),
        hyperviscosity: float = HYPERVISCOSITY,
        separation: float = SEPARATION,
        shifting: Shifting | None = None,
        dtype: Any = jnp.float32,
        **options: Any,
    ) -> DeltaSPH:
        """Builds the weakly compressible scheme from plain numbers, in the precision `dtype`.

        **Arguments**: `dx`, spacing (m); `c0`, numerical speed of sound (m/s), at least ten times the largest
        speed; `viscosity`, by default that of water; `kernel`, by default the Gaussian; `h_over_dx`, ratio of
        a Gaussian's smoothing length to dx (another kernel has the same width, see `AbstractKernel.width`);
        `period`, the periodic axes (`Box.period`); `hyperviscosity`, `separation`, regularisation strengths
        (set both to 0 to disable it); `options`, further fields by name.
        """
        kernel = Gaussian() if kernel is None else kernel
        viscosity = PhysicalViscosity(1.0e-6) if viscosity is None else viscosity

        def leaf(a):
            return jnp.asarray(a, dtype)

        return cls(
            smoothing=Smoothing(kernel, leaf(h_over_dx * dx * kernel.width), period),
            c0=leaf(c0),
            rho0=leaf(rho0),
            delta=leaf(delta),
            viscosity=jax.tree.map(leaf, viscosity),
            integrator=SymplecticEuler() if integrator is None else integrator,
            regularisation=regularisations(hyperviscosity, separation, leaf),
            shifting=() if shifting is None else (jax.tree.map(leaf, shifting),),
            **jax.tree.map(leaf, options),
        )

    # ---------------------------------------------------------------- interface of a scheme

    def pressure(self, p):
        """See `AbstractScheme.pressure`."""
        return laws.pressure(p.rho, self.c0)

    def with_pressure(self, p, pressure):
        """See `AbstractScheme.with_pressure`."""
        rho = laws.density_deviation(pressure, self.c0)
        m = p.m / (self.rho0 + p.rho) * (self.rho0 + rho)
        return eqx.tree_at(lambda a: (a.rho, a.m), p, (rho, m))

    def stable_dt(self, g, dim):
        """See `AbstractScheme.stable_dt`."""
        # for any kernel, h in Eq. 10 is the smoothing length of the Gaussian of the same width
        share = self.integrator.cfl / self.smoothing.kernel.width
        nu = float(self.viscosity.kinematic(self.smoothing.h, self.c0, dim))
        return stable_dt(float(self.smoothing.h), float(self.c0), nu, g, share)

    def respond(self, model, state, tables):
        """See `AbstractParticleScheme.respond`: this scheme needs no response, because its sound waves
        transmit the pressure of the air."""
        del model, state, tables
        return {}

    def description(self):
        """See `AbstractScheme.description`."""
        return f"weakly compressible, sound speed {float(self.c0):.3g} m/s"

    def cost(self, dx, dim):
        """See `AbstractScheme.cost`: 25 ns per neighbour and evaluation in two dimensions, 22 ns in three,
        measured with neighbour lists larger than the caches (in still water, the OWC and a dam break)."""
        pair = 25e-9 if dim == 2 else 22e-9
        return pair * self.integrator.evaluations * self.neighbours(dx, dim)

    def fastest(self, dt):
        """See `AbstractScheme.fastest`: above c0/3 the water is no longer weakly compressible."""
        return self.c0 / 3.0

    def compression(self, p):
        """See `AbstractScheme.compression`: sum m c0^2 (ln(rho/rho0) + rho0/rho - 1), and sum V R for every
        background R."""
        # Series of the exact expression, which would lose its digits to cancellation in float32.
        s = p.rho / self.rho0
        energy = jnp.sum(p.m * s * s * (0.5 - s * (2.0 / 3.0) + s * s * 0.75)) * self.c0**2
        for background in self.background:
            energy = energy + jnp.sum(self.volume(p) * background.pressure(p.x))
        return energy

    # ---------------------------------------------------------------- sources

    def water(self, p):
        """See `AbstractParticleScheme.water`: adds density deviation, and pressure minus the background."""
        water = super().water(p).water
        return Sources(water | {"rho": p.rho, "over": self._over_background(p.x, water["p"])}, {})

    def level_pressure(self, model, state):
        """See `AbstractParticleScheme.level_pressure`: the pressure in excess of the air pressure."""
        if not (model.chambers and model.walls.dummies):
            return {}
        p = self.pressure(state.particles)
        for chamber in model.chambers:
            x = chamber.frame.back(state.parts, columns(state.particles.x))
            p = p - state.parts[chamber.name].P_a * chamber.weight(x)
        return {"level_p": p}

    def sources(self, ghosts: GhostFields, u_ghosts: Float[Array, "G D"]) -> Sources:
        """Sources of the pair sums: the water, and the ghosts with velocities `u_ghosts` (m/s).

        The pressure p (Pa) is the excess over the background pressure.
        """
        # ghosts do not enter the diffusion and gradient of density; their density deviation is not used
        fields = {"x": columns(ghosts.x), "V": -ghosts.V, "u": columns(u_ghosts)}
        p = self._over_background(ghosts.x, ghosts.p)
        return ghosts.water.behind(fields | {"p": p, "rho": jnp.zeros_like(p)}, p="over")

    def _over_background(self, x: Float[Array, "N D"], p: Float[Array, " N"]) -> Float[Array, " N"]:
        """Pressures p (Pa) at points x (m) minus the background pressure, Pa."""
        for background in self.background:
            p = p - background.pressure(x)
        return p

    # ---------------------------------------------------------------- the two passes

    @Part.MOMENTUM.scope()
    def momentum(self, model: Model, p: Particles, sources: Sources, tables: Tables) -> Rates:
        """First pass: acceleration, m/s2 (Eq. 3, 4 or 6, gravity), and gradients of density, kg/m4 (Eq. 9).

        The gradients are renormalised and therefore exact for linear fields.
        """
        dim = p.x.shape[1]
        guard = laws.GUARD * self.smoothing.h**2
        viscous = self.rho0 * self.viscosity.coefficient(self.smoothing.h, self.c0, dim)

        def law(pair: Pair, i, j):
            force = laws.pressure_force(pair, i, j)
            shear = self.viscosity.shear(pair, i, j, guard)
            total = tuple(a + viscous * b for a, b in zip(force, shear, strict=True))
            return total, laws.moment_matrix(pair, i, j), laws.density_gradient(pair, i, j)

        force, M, b = tables.fluid.sum(law, self.smoothing, sources.water, sources)
        rho = self.rho0 + p.rho
        for background in self.background:
            along, up = background.force(p.x, self.smoothing.h)
            force = (force[0] + along, *force[1:-1], force[-1] + up)
        acceleration = [f / rho + g for f, g in zip(force, model.g, strict=True)]
        L = symmetric_inverse(M)
        grad_rho = symmetric_product(L, b)
        limited = {"gradient": jnp.sum(uncorrected(M) & (p.m > 0.0)).astype(rho.dtype)}
        return Rates(tuple(acceleration), grad_rho, trace_upper(M, dim), limited)

    @Part.CONTINUITY.scope()
    def continuity(self, p, sources, grad_rho, tables):
        """Second pass: rate of change of the density, kg/m3/s (Eq. 7 and 8-9)."""
        guard = laws.GUARD * self.smoothing.h**2
        diffusion = self.delta * self.smoothing.h * self.c0
        sources = _with_gradient(sources, grad_rho)
        rho0 = self.rho0

        def law(pair: Pair, i, j):
            rate = (rho0 + i["rho"]) * laws.divergence(pair, i, j)
            return rate + diffusion * laws.density_diffusion(pair, i, j, guard)

        return tables.fluid.sum(law, self.smoothing, sources.water, sources)

    def entries(self):
        """See `AbstractScheme.entries`."""
        return {name: entry for one in self.regularisation for name, entry in one.entries().items()}

    def limiters(self):
        """See `AbstractScheme.limiters`."""
        return {"gradient": "density gradients left uncorrected where there is too little water"}

    # ---------------------------------------------------------------- one step

    def step(self, model, state, tables):
        """See `AbstractScheme.step`."""
        return self.integrator.step(self, model, state, tables)

    # ---------------------------------------------------------------- diagnostics

    def losses(self):
        """See `AbstractScheme.losses`."""
        return {"viscous": "viscous dissipation", "diffusive": "dissipation by the density diffusion"}

    def dissipation(self, model, state, tables):
        """See `AbstractScheme.dissipation`. Source: energy balance of Antuono et al. 2015."""
        p, sources = state.particles, self._sources_now(model, state, tables)
        grad_rho = self.momentum(model, p, sources, tables).grad_rho
        sources = _with_gradient(sources, grad_rho)
        guard = laws.GUARD * self.smoothing.h**2

        def law(pair: Pair, i, j):
            return (
                self.viscosity.shear(pair, i, j, guard),
                laws.density_diffusion(pair, i, j, guard),
            )

        shear, diffusion = tables.fluid.sum(law, self.smoothing, sources.water, sources)
        viscous = self.rho0 * self.viscosity.coefficient(self.smoothing.h, self.c0, p.x.shape[1])
        V, rho = sources.water["V"], self.rho0 + p.rho
        loss_viscous = -jnp.sum(V * viscous * dot(columns(p.u), shear))
        rate = self.delta * self.smoothing.h * self.c0 * diffusion
        # d(e_c)/dt = p / rho^2 d rho/dt per unit mass
        loss_diffusive = -jnp.sum(V * laws.pressure(p.rho, self.c0) / rho * rate)
        return {"viscous": loss_viscous, "diffusive": loss_diffusive}

    def surface(self, model: Model, state: State, tables: Tables) -> Float[Array, " N"]:
        """Divergence of position (Eq. 15) in D dimensions: D in water, below `SURFACE` D at the surface."""
        sources = self._sources_now(model, state, tables)
        return self.momentum(model, state.particles, sources, tables).position_divergence

    def _sources_now(self, model: Model, state: State, tables: Tables) -> Sources:
        """Sources of the pair sums for a state: water, and ghosts with the viscous force's velocities."""
        ghosts = self.ghosts(model, state, tables, at_rest(model, state))
        ghosts = self.ghost_velocity(model, state.parts, tables, ghosts)
        return self.sources(ghosts, ghosts.u_shear)


def _with_gradient(sources: Sources, grad_rho: tuple[jax.Array, ...]) -> Sources:
    """Sources with the gradient of the water's density, kg/m4; the gradient is zero for walls."""
    none = jnp.zeros_like(sources.ghosts["V"])
    return sources.adding("grad_rho", grad_rho, tuple(none for _ in grad_rho))


SURFACE = 1.89 / 2.0
"""Divergence of position (Eq. 15) below which a particle is at the surface, divided by its ideal value (-):
1.89 of 2 in 2-D."""
