"""Architecture of the package, read from its source: imports between layers, owners of loops, names."""

import ast
import importlib
import re
import types
from collections import Counter
from pathlib import Path

import pytest

import jaxsph

LAYERS = (
    ("core",),
    ("model",),
    ("waves", "solids"),
    ("parts",),
    ("schemes",),
    ("probes",),
    ("problem",),
    ("case",),
    ("output",),
    ("run",),
    ("study",),
    ("report",),
    ("cli",),
)
"""Subpackages from the bottom up; each imports from lower layers, and its own files."""
LEAVES = {"errors", "start", "analysis"}
"""Modules outside the layers. Every file may import `errors`; files above `model` may import `analysis`,
which imports the theory of waves; only the facade imports `start`. `errors` and `start` import nothing from
jaxsph."""
DATA_FILES = {
    f"output.{name}"
    for name in ("hdf5", "run_file", "run_groups", "run_reader", "run_view", "sweep_file", "vtk")
}
"""Files of `output` that import no lower subpackage: those that write, read or export runs and sweeps."""
FACADE = "__init__"
HEIGHT = {room: height for height, rooms in enumerate(LAYERS) for room in rooms}

PACKAGE = Path(jaxsph.__file__).parent
SOURCES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py" or path.parent == PACKAGE
}
TREES = {file: ast.parse(path.read_text(encoding="utf-8")) for file, path in SOURCES.items()}
FILES = sorted(set(SOURCES) - {FACADE, "__main__"})


def _imports(tree):
    """(module, names) of every import, including imports inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield node.module, tuple(alias.name for alias in node.names)


def _imported(tree):
    """Files of the package that a file imports; the package itself counts as the facade."""
    for module, names in _imports(tree):
        if module == "jaxsph":
            yield from (name if name in {*SOURCES, *LEAVES} else FACADE for name in names or (FACADE,))
        elif module.startswith("jaxsph."):
            path = module.removeprefix("jaxsph.")
            if path in SOURCES:
                yield path
            else:
                yield from (f"{path}.{name}" for name in names)


def _room(file):
    return file.split(".")[0]


def _allowed(file, imported):
    room, other = _room(file), _room(imported)
    if imported == "errors" or (other == "analysis" and HEIGHT.get(room, 99) > HEIGHT["model"]):
        return True
    if imported == FACADE:
        return room == "cli"
    if room == "analysis":
        return imported == "waves.theory" or other == room
    if room == other:
        return room not in LEAVES
    if file in DATA_FILES:
        return False
    return HEIGHT[other] < HEIGHT[room]


def test_every_room_has_its_layer():
    assert {_room(file) for file in FILES} == set(HEIGHT) | LEAVES


@pytest.mark.parametrize("file", FILES)
def test_imports_go_downward_only(file):
    wrong = sorted({other for other in _imported(TREES[file]) if not _allowed(file, other)})
    assert not wrong, f"{file} imports {', '.join(wrong)}"


def test_files_of_a_room_do_not_import_each_other_in_circles():
    known = {file: set(_imported(TREES[file])) & set(FILES) for file in FILES}
    order = []
    while known:
        free = [file for file, others in known.items() if not (others - {file}) & set(known)]
        assert free, f"circle among {sorted(known)}"
        order += free
        for file in free:
            del known[file]


def test_leaf_and_facade_import_no_room():
    # The facade imports its subpackages by name when they are first used.
    assert not list(_imported(TREES["errors"])) and not list(_imported(TREES["start"]))
    assert set(_imported(TREES[FACADE])) == {"start"}


@pytest.mark.parametrize(
    ("name", "owners"),
    [
        # over time, over the slots of a table, over the stages of a Runge-Kutta step, and over the steps of a
        # mooring line in a step of the water
        ("scan", {"core.loop", "core.pairs", "model.mechanism", "parts.line"}),
        # over a number of blocks of the time loop, over the candidates of a line of cells, and over Newton's
        # steps for a root and for laws of several chambers
        ("fori_loop", {"core.loop", "core.roots", "core.search.cells", "schemes.air"}),
        ("while_loop", {"schemes.poisson"}),  # over the Krylov iterations
        ("checkpoint", {"core.transforms", "core.pairs"}),  # of steps and blocks, and of slots
    ],
)
def test_loops_have_owners(name, owners):
    def uses(tree):
        attributes = (n for n in ast.walk(tree) if isinstance(n, ast.Attribute) and n.attr == name)
        # jax.checkpoint, jax.lax.scan and lax.scan count, but not methods such as RunFile.checkpoint
        return any(ast.unparse(n.value) in ("jax", "lax", "jax.lax") for n in attributes)

    assert {file for file, tree in TREES.items() if uses(tree)} == owners


def test_time_loop_is_built_of_loop():
    assert "core.loop" in set(_imported(TREES["run.simulate"]))


def test_jax_md_stays_behind_the_search():
    users = {
        file
        for file, tree in TREES.items()
        if any(module.split(".")[0] == "jax_md" for module, _ in _imports(tree))
    }
    assert users <= {"core.search.jax_md"}


def test_parts_of_scipy_are_loaded_where_they_are_used():
    """`import scipy` takes no time; its subpackages would take a tenth of the start of every command."""
    found = [(file, name, of) for file, tree in TREES.items() for name, of in _imports(tree)]
    assert not [one for one in found if one[1].startswith("scipy.") or (one[1] == "scipy" and one[2])]


def test_optional_physics_is_no_flag():
    fields = [
        (file, node.target.id)
        for file, tree in TREES.items()
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


def test_rooms_do_not_hide_public_names_called_the_same():
    """js.run must not become the subpackage jaxsph.run as soon as that subpackage is imported."""
    for room in {room for rooms in LAYERS for room in rooms}:
        importlib.import_module(f"jaxsph.{room}")
    modules = [name for name in jaxsph.__all__ if isinstance(getattr(jaxsph, name), types.ModuleType)]
    assert not modules


LONG = {"case.assemble.assemble": "an argument and a line for each thing that a model is made of"}
"""Functions of more than 60 lines, and why."""
WIDE = {
    "case.assemble.assemble": "keywords, one for each kind of part and each number",
    "cli.calibration.calibrate": "an argument for each option of the command",
    "cli.coefficients.coefficients": "an argument for each option of the command",
    "cli.running.resume": "an argument for each option of the command",
    "cli.running.run": "an argument for each option of the command",
    "cli.matrix.matrix": "an argument for each option of the command",
    "cli.searching.optimise": "an argument for each option of the command",
    "cli.searching.slope": "an argument for each option of the command",
    "cli.studies.sweep": "an argument for each option of the command",
    "schemes.incompressible.of": "an argument for each choice, all but two with a default",
    "schemes.weakly_compressible.of": "an argument for each choice, all but two with a default",
    "solids.walls.build": "an argument for each thing that walls can be made of",
}
"""Functions of more than eight arguments, and why."""
TRACED = ("core", "model", "waves", "solids", "parts", "schemes", "probes")


def test_files_are_short():
    """A file has one subject, and can be read in one sitting."""
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in PACKAGE.rglob("*.py")}
    assert not {path.relative_to(PACKAGE).as_posix() for path, count in lines.items() if count > 450}


def _functions():
    for file, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                yield f"{file}.{node.name}", node


def test_functions_are_short():
    long = {name for name, node in _functions() if node.end_lineno - node.lineno + 1 > 60}
    assert long == set(LONG)


def test_functions_take_few_arguments():
    def count(node):
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        return len([one for one in every if one.arg not in ("self", "cls")])

    assert {name for name, node in _functions() if count(node) > 8} == set(WIDE)


def test_parts_that_are_off_are_no_branches():
    """Traced code has no `is None`: an empty tuple switches a part off. Functions that build parts on the
    host from plain arguments (`of`, `build` and the others in `host`) may compare with None."""
    host = {"of", "build", "lattice", "of_dict", "__check_init__"}
    branches = []
    for name, node in _functions():
        if name.split(".")[0] in TRACED and node.name not in host:
            tests = [n for n in ast.walk(node) if isinstance(n, ast.Compare)]
            none = [
                t
                for t in tests
                if any(isinstance(c, ast.Constant) and c.value is None for c in t.comparators)
            ]
            branches += [name] * len(none)
    assert branches == []


def test_keys_of_a_case_are_named_by_cases_alone():
    """Messages of parts and problems name no TOML keys, because a user may have built them without a case."""
    sections = "air|device|fluid|kernel|output|pto|scheme|search|tank|waves"
    key = re.compile(rf"(?<![\w.`])({sections})\.[a-z]\w*(?!\w*\()")
    found = []
    for file, tree in TREES.items():
        if _room(file) in (*TRACED, "problem"):
            docs = {
                id(node.body[0].value)
                for node in ast.walk(tree)
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
                and node.body
                and isinstance(node.body[0], ast.Expr)
            }
            found += [
                f"{file}: {node.value}"
                for node in ast.walk(tree)
                if isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and id(node) not in docs
                and key.search(node.value)
                and not node.value.startswith("jaxsph")
            ]
    assert found == []


def _words(texts):
    return Counter(word for text in texts for word in re.findall(r"\w+", text))


def test_nothing_is_defined_that_nobody_uses():
    """Every function, method and class is named at least once more, in the package or in texts for users.

    Use in a test alone does not count. Functions with a framework's decorator, and the handlers that
    `http.server` calls, count as used.
    """
    plain = {"property", "classmethod", "staticmethod", "abc.abstractmethod"}
    defined = Counter()
    for tree in TREES.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                if {ast.unparse(decorator) for decorator in node.decorator_list} <= plain:
                    defined[node.name] += 1
    root = PACKAGE.parent
    told = [
        *root.glob("*.md"),
        *root.glob("docs/**/*.md"),
        *root.glob("docs/*.py"),
        *root.glob("examples/*.py"),
    ]
    told += [*root.glob("experiments/*.py"), *root.glob("notebooks/*.ipynb")]
    named = _words(path.read_text(encoding="utf-8") for path in [*PACKAGE.rglob("*.py"), *told])
    handlers = {"do_GET", "log_message"}
    unused = {name for name, times in defined.items() if named[name] <= times and not name.startswith("__")}
    assert unused - handlers == set()
