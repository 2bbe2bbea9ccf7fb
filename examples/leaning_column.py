"""A water column behind a leaning wall: slopes with respect to the wall's angle and draught and the chamber's
length.

jaxsph slope examples/leaning_column.py:column --over angle --of energy_pto --set t1=1.0
"""

import math

import jax

import jaxsph as js


def column(
    angle: float = 0.57,  # of the wall from the vertical, rad
    draught: float = 0.107,  # m
    length: float = 0.413,  # of the chamber at the surface, m
    dx: float = 0.04,
    t1: float = 0.2,
    precision: str = "float32",
) -> js.Problem:
    tank, level, top, thickness = 2.0, 0.4, 0.7, 0.16
    lean = math.tan(angle)
    tip = [tank - length - draught * lean, level - draught]
    head = [tip[0] + (top - tip[1]) * lean, top]
    front = [[tip[0] - thickness, tip[1]], tip, head, [head[0] - thickness, top]]
    parts = {
        "tank": {"length": tank, "depth": level, "height": top},
        "start": {"amplitude": 0.02},
        "scheme": {"kind": "incompressible", "tolerance": 1e-10 if precision == "float64" else 1e-4},
        "solid": {"front": {"polygon": front}},
        "chamber": {"column": {"between": ["front", "far"], "pto": {"K_dm": 100.0}}},
        "output": {"sample_dt": 0.01},
    }
    run = {"name": "leaning_column", "dx": dx, "t1": t1, "precision": precision}
    return js.Case.from_dict(run | parts).problem()


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    program = js.Program(column, {"precision": "float64"})
    found = js.derivative(program, "angle", of="energy_pto", method=js.Exact())
    print(f"{found.value:.4f} J/m, with a slope of {found.slope:.4f} J/m per rad")
