"""Standing wave of `bench_peers` by jaxsph: writes time and centre of mass of the water into a CSV file.

python standing_wave_jaxsph.py --csv OUT.csv --dx 0.02 --scheme incompressible --end 11.8 --interval 0.03
"""

from __future__ import annotations

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import jaxsph as js


class Centre(js.AbstractProbe):
    """Probe of the horizontal centre of mass of the water."""

    def measure(self, model, state, tables):
        """Centre of mass (m) of particles with equal masses."""
        return {"centre_x": jnp.mean(state.particles.x[:, 0])}

    def describe(self):
        """Unit and meaning of the reading."""
        return {"centre_x": js.Reading("m", "horizontal centre of mass of the water")}


def main() -> None:
    """Runs the wave for the given duration."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--csv", type=Path, required=True)
    parser.add_argument("--dx", type=float, required=True, help="spacing, m")
    parser.add_argument("--scheme", default="incompressible")
    parser.add_argument("--end", type=float, required=True, help="duration, s")
    parser.add_argument("--interval", type=float, required=True, help="time between two rows, s")
    given = parser.parse_args()
    case = js.load_case("hydrostatic").replace(
        {
            "dx": given.dx,
            "tank.length": 1.0,
            "tank.depth": 0.5,
            "start.amplitude": 0.025,
            "scheme.kind": given.scheme,
            "probes.pressure": None,
            "output.sample_dt": given.interval,
        }
    )
    solution = js.run(case.problem().with_parts(probes=[Centre()], t1=given.end), devices=1)
    rows = np.stack([solution.t, solution["centre_x"]], axis=1)
    np.savetxt(given.csv, rows, delimiter=",", header="t,x_c", comments="")


if __name__ == "__main__":
    main()
