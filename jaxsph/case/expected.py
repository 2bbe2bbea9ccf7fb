"""Keys that users of other programs may expect in a case, and what to use instead."""

from __future__ import annotations

_BED = (
    "a sloping or stepped bed is a solid: [solid.bed] with the corners of a polygon, as in the built-in "
    "cases `beach` and `owc_slope`"
)
_MESH = (
    "a shape is a block, a disc, a polygon or the outline of a drawing (`file` names an SVG or DXF file, or "
    "a CSV file with columns x and z), and in three dimensions a block, a sphere, a cylinder, a capsule, a "
    "solid of revolution, a prism (`body.extrusion`) or a surface mesh (`file` names an STL or OBJ file)"
)
_MOORING = (
    "a mooring line is a section [mooring.NAME] with `mooring.NAME.anchor`, `mooring.NAME.at` on a body, "
    "`mooring.NAME.length` and other keys; springs between a body and the tank are links, [link.NAME] with "
    "`link.NAME.between` and `link.NAME.at`, as in the built-in case `box_moored`"
)
_LINK = (
    "a spring, damper, end stop or latch is a link, [link.NAME] with `link.NAME.stiffness`, "
    "`link.NAME.damping` or other keys, along one motion of a body or between two points; with "
    "`link.NAME.take_off` it is a power take-off"
)
_JOINT = (
    'a joint is given in the section of its body: `body.free` is ["pitch"] for a hinge at `body.pivot`, and '
    '["surge"] or ["heave"] for a slider; with several bodies, `bodies.NAME.joined_to` is the body to which '
    "NAME is joined"
)
_DIRECTION = (
    "the direction of waves is `waves.direction`, rad from the tank's axis, and a directional sea has "
    "`waves.spreading`, the exponent s of cos^2s(theta/2); both need `tank.width` and a relaxation zone, "
    "`waves.zone`"
)
_SIDES = (
    "absorption at the side walls: if a relaxation zone, `waves.zone`, makes the waves, give "
    "`waves.side_zones`, the width of relaxation zones along these walls, m; in a tank without "
    "incident waves, give `sponge.sides`"
)
_STEP = "the time step follows from `dx` and the expected speeds; `scheme.cfl` changes it"
_END = "the end of a run is `t1`, s"
_SPACING = "the spacing of the particles is `dx`, m"
_LOADED = (
    "the water's forces on bodies and solids are always recorded in the run file, as `body_force` for the "
    "section [body], `body_force_NAME` for [bodies.NAME] and `force_NAME` for [solid.NAME]"
)
_HEIGHT = "the height of regular waves, twice their amplitude, is `waves.H`, m; a sea has `waves.Hs`, m"
_PERIOD = "regular waves have the period `waves.T`, s, and a sea its peak period `waves.Tp`"

EXPECTED = {
    **dict.fromkeys(("slope", "bed", "bathymetry", "bottom", "beach", "bed_slope"), _BED),
    **dict.fromkeys(("stl", "mesh", "obj", "geometry", "vtk"), _MESH),
    **dict.fromkeys(("moorings", "catenary", "anchors", "tether", "cable"), _MOORING),
    **dict.fromkeys(("joint", "joints", "constraint", "hinge", "slider"), _JOINT),
    **dict.fromkeys(("link", "links", "spring", "springs", "damper", "dampers", "end_stops"), _LINK),
    **dict.fromkeys(("latching", "power_take_off", "linear_pto"), _LINK),
    **dict.fromkeys(("sides", "side_walls", "side_sponge", "side_absorption", "walls_absorb"), _SIDES),
    **dict.fromkeys(("direction", "heading", "directions", "spreading", "angle_of_incidence"), _DIRECTION),
    **dict.fromkeys(("current", "currents"), "currents are not available"),
    **dict.fromkeys(("wind",), "wind is not available"),
    **dict.fromkeys(("dt", "time_step", "timestep"), _STEP),
    **dict.fromkeys(("t_end", "tmax", "timemax", "end_time", "duration", "simulation_time"), _END),
    **dict.fromkeys(("dp", "resolution", "particle_spacing", "particle_distance", "h"), _SPACING),
    **dict.fromkeys(("forces", "force", "loads"), _LOADED),
    **dict.fromkeys(("amplitude", "height", "wave_height"), _HEIGHT),
    **dict.fromkeys(("period", "frequency", "omega", "wavelength"), _PERIOD),
    "surface_tension": "surface tension is not available",
    "turbulence": "turbulence models are not available; water has the kinematic viscosity `fluid.nu`",
    "scale": "a case is computed at the scale of its lengths; there is no scale factor",
    "gauges": "give the gauges as `probes.gauges`, a list of positions x, m",
    "draft": "the draught of a front wall is `device.draught`, m; a body's draught follows from its mass",
    "orifice": "an orifice is `pto.area`, m2 (in two dimensions m2 per metre of width), with `pto.discharge`",
}
"""Hints on what to use instead of a key, by the last part of the key's name in lower case."""

ONLY_IN = {"amplitude": "waves", "height": "waves", "h": "", "duration": "", "angle_of_incidence": "waves"}
"""Section of each key whose hint applies in one section only; empty for the top level."""


def instead(key: str) -> str:
    """Hint on what to use instead of an unknown dotted key; empty if there is no hint for this key."""
    section, _, last = key.lower().rpartition(".")
    if last not in EXPECTED or ONLY_IN.get(last, section) != section:
        return ""
    return EXPECTED[last]
