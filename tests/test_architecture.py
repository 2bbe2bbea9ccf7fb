"""The layers of the package, read from its source: who imports whom, who owns loops, names."""

import ast
import re
from pathlib import Path

import pytest

import jaxsph

# Layers from the bottom up. Inside a layer a room may import those named before it in the same tuple
# (`case` makes the probes it describes, `driver` ends with the analysis, `plot` reads what `io` wrote).
LAYERS = (
    ("_typing", "kernels", "transforms", "pairs", "neighbours", "loop"),
    ("state", "laws", "waves"),
    ("shapes", "boundaries", "devices", "bodies"),
    ("schemes", "wcsph", "isph", "tangents"),
    ("probes", "case"),
    ("analysis", "linear", "driver"),
    ("io", "plot", "design", "gradients"),
    ("__main__",),
)
UNRELATED = {
    ("loop", "pairs"),
    ("loop", "neighbours"),
    ("loop", "kernels"),
    ("devices", "boundaries"),
    ("bodies", "boundaries"),
    ("bodies", "devices"),
    ("devices", "shapes"),
    ("isph", "wcsph"),
}
"""Pairs that the order within a layer would allow and the design does not."""
LEAF = "errors"
"""Imports nothing of the package; anyone may import it."""
HOST_ONLY = "io"
"""Files know nothing of the physics: `io` imports errors alone, so `driver`, below it, may use it."""
FACADE = "__init__"
ORDER = {room: (height, place) for height, row in enumerate(LAYERS) for place, room in enumerate(row)}

SOURCES = {path.stem: path for path in Path(jaxsph.__file__).parent.glob("*.py")}
TREES = {room: ast.parse(path.read_text(encoding="utf-8")) for room, path in SOURCES.items()}


def _imports(tree):
    """(module, names) of every import, those inside functions included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield node.module, tuple(alias.name for alias in node.names)


def _rooms(tree):
    """Rooms of the package that a module imports; the package itself counts as the facade."""
    for module, names in _imports(tree):
        if module == "jaxsph":
            yield from (name if name in SOURCES else FACADE for name in names or (FACADE,))
        elif module.startswith("jaxsph."):
            yield module.split(".")[1]


def _allowed(room, imported):
    if imported == LEAF or (room, imported) == ("driver", HOST_ONLY):
        return True
    if imported == FACADE:
        return room == "__main__"
    if room == HOST_ONLY or (room, imported) in UNRELATED:
        return False
    return ORDER[imported] < ORDER[room]


def test_every_room_has_its_layer():
    assert set(SOURCES) == set(ORDER) | {LEAF, FACADE}


@pytest.mark.parametrize("room", sorted(ORDER))
def test_imports_go_downward_only(room):
    wrong = sorted({other for other in _rooms(TREES[room]) if not _allowed(room, other)})
    assert not wrong, f"{room} imports {', '.join(wrong)}"


def test_leaf_and_facade_import_no_room():
    # The facade imports its rooms by name when they are first used.
    assert not list(_rooms(TREES[LEAF])) and not list(_rooms(TREES[FACADE]))


@pytest.mark.parametrize(
    ("name", "owners"),
    [
        ("scan", {"loop", "pairs"}),  # over time, and over the slots of a table
        ("fori_loop", {"neighbours"}),  # over the candidates of a line of cells
        ("while_loop", set()),
        ("checkpoint", {"transforms", "pairs"}),  # of steps and blocks, and of slots
    ],
)
def test_loops_have_owners(name, owners):
    def uses(tree):
        attributes = (n for n in ast.walk(tree) if isinstance(n, ast.Attribute) and n.attr == name)
        # jax.checkpoint, jax.lax.scan, lax.scan: not a method such as RunFile.checkpoint
        return any(ast.unparse(n.value) in ("jax", "lax", "jax.lax") for n in attributes)

    assert {room for room, tree in TREES.items() if uses(tree)} == owners


def test_time_loop_is_built_of_loop():
    assert "loop" in set(_rooms(TREES["driver"]))


def test_jax_md_stays_behind_the_search():
    users = {
        room
        for room, tree in TREES.items()
        if any(module.split(".")[0] == "jax_md" for module, _ in _imports(tree))
    }
    assert users <= {"neighbours"}


def test_optional_physics_is_no_flag():
    fields = [
        (room, node.target.id)
        for room, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and node.target.id.startswith("is_")
    ]
    assert not fields


def test_names_say_what_a_thing_is():
    empty = re.compile(r"util|manager|handler", re.IGNORECASE)
    named = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    names = [node.name for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, named)]
    assert not [name for name in [*SOURCES, *names] if empty.search(name)]
