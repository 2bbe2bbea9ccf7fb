"""Seeded random mutations of case files: of their bytes, and of the values in them."""

import copy
import datetime
import importlib.resources
import math
import random
import tomllib

import jaxsph as js
from jaxsph.case.case import Case, key_names

CASES = {
    name: importlib.resources.files("jaxsph").joinpath("cases", f"{name}.toml").read_bytes()
    for name in js.built_in_cases()
}
KEYS = key_names(Case)
SMALL = {
    "basin": {
        "dx": 0.1,
        "tank": {"length": 4.2, "width": 2.4, "depth": 0.5, "height": 1.0},
        "waves.zone": 1.1,
        "waves.side_zones": 0.6,
        "sponge.length": 1.0,
        "probes.surface": [[2.0, 1.2]],
    },
    "beach": {"dx": 0.05, "tank.length": 5.0, "solid.beach.polygon": [[3.0, 0.0], [5.0, 0.5], [5.0, 0.0]]},
    "box_in_waves": {"dx": 0.05, "tank.length": 5.0, "sponge.length": 1.2},
    "box_moored": {"dx": 0.05, "tank.length": 5.0, "sponge.length": 1.2},
    "breakwater": {"dx": 0.05, "probes.gauges": []},
    "buoy_heave": {"dx": 0.05, "tank.length": 5.0, "sponge.length": 1.2},
    "dam_break": {"dx": 0.1, "tank.length": 2.4},
    "dam_break_column": {"dx": 0.06, "tank.layer": None, "tank.width": 0.6, "tank.length": 1.2},
    "flap_2d": {"dx": 0.06, "tank.length": 8.1},
    "flap_3d": {"dx": 0.08, "tank.length": 4.0},
    "flap_floating": {"dx": 0.04, "tank.length": 5.0, "sponge.length": 1.2},
    "focused_wave": {"dx": 0.05, "waves.t": 4.0},
    "hydrostatic": {"dx": 0.1},
    "owc_irregular": {"dx": 0.04, "device.wall_thickness": 0.04, "probes": {}, "waves.duration": 30.0},
    "owc_ning": {"dx": 0.08, "device.wall_thickness": 0.08, "tank.length": 6.0},
    "owc_slope": {
        "dx": 0.04,
        "solid.front.polygon": [[5.82, 0.36], [5.94, 0.36], [6.24, 0.76], [6.12, 0.76]],
    },
    "owc_floating": {"dx": 0.04, "tank.length": 5.4, "sponge.length": 1.2},
    "owc_two_chambers": {"dx": 0.05, "solid.front.block.low": [4.57, 0.28]},
    "raft": {
        "dx": 0.04,
        "tank.length": 5.6,
        "sponge.length": 1.2,
        "bodies.fore.block": {"low": [3.0, 0.36], "high": [3.48, 0.44]},
        "bodies.aft.block": {"low": [3.56, 0.36], "high": [4.04, 0.44]},
        "bodies.aft.pivot": [3.52, 0.4],
    },
    "section_fixed": {"dx": 0.08, "tank.length": 8.5},
    "owc": {"dx": 0.04, "tank.length": 2.4, "device.wall_thickness": 0.04, "probes": {}},
    "vessel": {"dx": 0.04, "device.wall_thickness": 0.04},
    "sphere_decay": {
        "dx": 0.075,
        "tank": {"length": 1.6, "width": 1.6, "depth": 0.6},
        "body.sphere.centre": [0.8, 0.8, 0.63],
    },
    "buoy_3d": {
        "dx": 0.1,
        "tank": {"length": 2.8, "width": 1.4, "depth": 0.6, "height": 1.2},
        "sponge.length": 0.8,
        "body.cylinder": {"foot": [1.6, 0.7, 0.35], "head": [1.6, 0.7, 0.85], "radius": 0.24},
    },
    "hull": {"dx": 0.075},
    "owc_3d": {
        "dx": 0.1,
        "tank": {"length": 2.0, "width": 0.8, "depth": 0.5, "height": 1.0},
        "solid.front.block": {"low": [1.4, 0.2, 0.2], "high": [1.6, 0.6, 1.0]},
        "solid.left.block": {"low": [1.4, 0.0, 0.0], "high": [2.0, 0.2, 1.0]},
        "solid.right.block": {"low": [1.4, 0.6, 0.0], "high": [2.0, 0.8, 1.0]},
        "chamber.main.at": [1.8, 0.4],
    },
    "owc_spar": {
        "dx": 0.1,
        "tank": {"length": 2.4, "width": 1.2, "depth": 0.6, "height": 1.2},
        "sponge.length": 0.6,
        "bodies.spar.revolution": {
            "profile": [[0.0, 0.8], [0.2, 0.8], [0.2, 0.3], [0.35, 0.3], [0.35, 1.0], [0.0, 1.0]],
            "axis": [1.0, 0.6],
        },
        "bodies.spar.mass": 77.8,
        "chamber.main.at": [1.0, 0.6],
    },
    "wave_tank": {"dx": 0.05},
    "wave_tank_3d": {"dx": 0.1, "tank.height": 1.0},
    "wedge_entry": {"dx": 0.05},
}
"""Changes that make the built-in cases small enough to build by the hundred."""
PIECES = (
    b"\xff\xfe",
    b"\xc3",
    b"\x00",
    b"\n[body]\ndisc = { centre = [0.5, 0.5], radius = 0.2 }\n",
    b"\n[scheme]\n",
    b"\n[isph]\ncfl = 0.1\n",
    b'\n[[tank]]\nname = "x"\n',
    b"\nx = " + b"[" * 3000 + b"]" * 3000,
    b"\nx = " + b"{a=" * 2000 + b"1" + b"}" * 2000,
    b"\ndx = " + b"9" * 5000,
    b"\ng = 0x" + b"f" * 5000,
    b"\nt1 = 1979-05-27T07:32:00Z",
    b'"',
    b"'''",
    b"=",
    b"#",
    b"\n",
    b"nan",
    b"-",
    b"e400",
    b"_",
    b"inf",
)
VALUES = (
    0,
    -1,
    1,
    3,
    5e-324,
    1e-320,
    1e-30,
    1e-5,
    0.5,
    1e5,
    1e30,
    1e308,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    2**31,
    2**63,
    10**400,
    16**5000,
    True,
    "",
    "0.5",
    "a/b",
    "x" * 10_000,
    "gaussian",
    "incompressible",
    (),
    [],
    {},
    [0.1],
    [0.1, 0.2],
    [[0.1, 0.2], [0.3]],
    [math.nan, 1.0],
    [0.1] * 20_000,
    {"kind": "incompressible"},
    {"cfl": 0.1},
    {"a": {"b": 1}},
    None,
    datetime.date(2020, 1, 1),
)


def nested(depth):
    """A list nested `depth` deep."""
    value = []
    for _ in range(depth):
        value = [value]
    return value


def mutated_text(rng):
    """Bytes of a built-in case's file with up to four places changed."""
    text = bytearray(rng.choice(list(CASES.values())))
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(text) + 1)
        match rng.randrange(7):
            case 0:
                text[at:at] = rng.choice(PIECES)
            case 1:
                text[at : at + 1] = bytes([rng.randrange(256)])
            case 2:
                del text[at : at + rng.randint(1, 40)]
            case 3:
                text[at:at] = text[rng.randrange(len(text) + 1) :][: rng.randint(1, 60)]
            case 4:
                lines = text.split(b"\n")
                rng.shuffle(lines)
                text = bytearray(b"\n".join(lines))
            case 5:
                digits = [i for i, byte in enumerate(text) if chr(byte).isdigit()]
                if digits:
                    text[rng.choice(digits)] = ord(rng.choice("0123456789.e-"))
            case 6:
                lines = text.split(b"\n")
                lines[rng.randrange(len(lines))] = rng.choice(KEYS).encode() + b" = 0.5"
                text = bytearray(b"\n".join(lines))
        if not text:
            break
    return bytes(text)


def _polygon(rng):
    """Corners near the middle of a tank; sides often cross, and corners may lie on a line or coincide."""
    corners = [[rng.uniform(0.2, 1.8), rng.uniform(-0.1, 1.0)] for _ in range(rng.randint(2, 7))]
    match rng.randrange(4):
        case 0:
            corners.append(corners[0])
        case 1:
            corners = [[x, 0.3] for x, _ in corners]
        case 2:
            corners = sorted(corners)
    return corners


def _body(rng):
    """A body of any shape, free or not."""
    at, size = rng.uniform(0.1, 2.0), 10 ** rng.uniform(-3, 1)
    shape = rng.choice(
        [
            {"polygon": _polygon(rng)},
            {"disc": {"centre": [at, rng.uniform(0, 1)], "radius": size}},
            {"block": {"low": [at, 0.1], "high": [at + size, 0.1 + rng.uniform(0, 1)]}},
        ]
    )
    free = rng.sample(["surge", "heave", "pitch"], rng.randint(0, 3))
    return shape | {"free": free, "density": 10 ** rng.uniform(1, 5), "angle": rng.choice([0.0, 0.3, 1.6])}


def _set(data, key, value):
    *path, last = key.split(".")
    for part in path:
        if not isinstance(data.get(part), dict):
            data[part] = {}
        data = data[part]
    if value is None:
        data.pop(last, None)
    else:
        data[last] = value


def _numbers(data, path=()):
    for key, value in data.items():
        if isinstance(value, dict):
            yield from _numbers(value, (*path, key))
        elif isinstance(value, float):
            yield ".".join((*path, key)), value


def mutated_values(rng):
    """Mapping of a small built-in case with up to three values changed."""
    name = rng.choice(list(CASES))
    data = {"name": name} | tomllib.loads(CASES[name].decode())
    for key, value in SMALL[name].items():
        _set(data, key, value)
    if "probes" in data and rng.random() < 0.7:
        del data["probes"]  # otherwise changed lengths would be refused because of the probes
    for _ in range(rng.randint(1, 3)):
        match rng.randrange(8):
            case 0 | 1:
                _set(data, rng.choice(KEYS), copy.copy(rng.choice(VALUES)))
            case 2 | 3 | 4:
                key, value = rng.choice(list(_numbers(data)))
                wide = 6 if rng.random() < 0.3 else 0.4
                _set(data, key, value * 10 ** rng.uniform(-wide, wide))
            case 5:
                other = tomllib.loads(CASES[rng.choice(list(CASES))].decode())
                sections = [key for key, value in other.items() if isinstance(value, dict)]
                section = rng.choice(sections)
                data[section] = other[section]
            case 6:
                if rng.random() < 0.2:
                    _set(data, rng.choice(KEYS), nested(rng.choice([3, 50, 900])))
                else:
                    data["body"] = _body(rng)
                    data.pop("device", None)
                    data.pop("pto", None)
            case 7:
                kind = rng.choice(["weakly_compressible", "incompressible"])
                data["scheme"] = {"kind": kind}
    return data


def mutations(seed, count):
    """Yields (number, bytes or mapping) of `count` mutations; equal seeds give equal mutations."""
    for number in range(count):
        rng = random.Random(f"{seed}-{number}")
        yield number, mutated_text(rng) if number % 3 == 0 else mutated_values(rng)
