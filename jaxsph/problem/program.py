"""Program: a function in a user's file that builds a problem, with values for its arguments."""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import inspect
import marshal
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxsph.errors import CaseError
from jaxsph.problem.problem import Problem
from jaxsph.problem.toml import toml_text

_loaded: dict[str, ModuleType] = {}
"""Modules of the files imported so far, by path."""

VALUES = bool | int | float | str
"""Types allowed for an argument or for an element of a list argument; a file can store all of them."""


class Program:
    """Function that returns a `Problem`, with values for its arguments; see `jaxsph run FILE:FUNCTION`."""

    def __init__(self, function: Callable[..., Problem], arguments: Mapping[str, Any] | None = None) -> None:
        """**Arguments**: `arguments`: values by name; the function's other arguments have their defaults.
        **Raises** CaseError for an unknown argument, an argument without a value, or a value that a file
        cannot store (a file stores numbers, booleans, strings and lists of these).
        """
        self.name = function.__name__
        self._function, self._place = function, _place_of(function)
        self.arguments = _arguments(self, function, arguments or {})

    @classmethod
    def load(cls, place: str, arguments: Mapping[str, Any] | None = None) -> Program:
        """Program of "FILE.py:FUNCTION". **Raises** CaseError if the function cannot be found or imported."""
        return cls(_function_at(place), arguments)

    def __repr__(self) -> str:
        """The function call that builds the problem."""
        return f"{self.place}({', '.join(f'{k}={v!r}' for k, v in self.arguments.items())})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the place of the function, so that a worker process imports the file itself."""
        if self._place:
            return Program.load, (self._place, self.arguments)
        return Program, (self._function, self.arguments)

    @property
    def place(self) -> str:
        """Place of the function, "FILE.py:FUNCTION"; the name alone if it cannot be imported from a file."""
        return self._place or self.name

    @property
    def importable(self) -> bool:
        """Whether another process can import the function."""
        return bool(self._place)

    @property
    def digest(self) -> str:
        """SHA-256 of the function's file (without one, of its source text); empty for an unreadable file."""
        try:
            text = (
                Path(self._place.rpartition(":")[0]).read_bytes() if self._place else _text_of(self._function)
            )
        except OSError:
            return ""
        return hashlib.sha256(text).hexdigest()

    def problem(self) -> Problem:
        """Calls the function. **Raises** CaseError if the function fails or does not return a `Problem`."""
        try:
            made = self._function(**self.arguments)
        except CaseError as error:
            raise CaseError(f"{self}: {error}") from None
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}, line {frame.lineno}"
            raise CaseError(f"{self} raised {type(error).__name__}: {error} ({where})") from error
        if not isinstance(made, Problem):
            raise CaseError(
                f"{self} returned {_kind(made)}: must be a js.Problem, for example js.Problem(model, "
                "state, sample_dt, t1)"
            )
        if made.name == "assembled":
            made.name = self.name
        return made

    def replace(self, changes: Mapping[str, Any]) -> Program:
        """Copy with changed arguments, by name; None restores defaults. **Raises** CaseError as `Program`."""
        wanted = {k: v for k, v in {**self.arguments, **changes}.items() if v is not None}
        return Program(self._function, wanted)

    def value(self, name: str) -> Any:
        """Value of an argument. **Raises** CaseError if the function has no argument `name`."""
        if name not in self.arguments:
            raise CaseError(_unknown(self, name, self.arguments))
        return self.arguments[name]

    def built(self, name: str) -> Any:
        """See `Source.built`: the value as given."""
        return self.value(name)

    def to_toml(self) -> str:
        """TOML text with the names of the program's file and function, its digest and its arguments."""
        place = self.place.replace("\\", "/").rpartition("/")[2]
        words = (inspect.getdoc(self._function) or "").partition("\n")[0]
        about = {"name": self.name, "description": words, "program": place, "digest": self.digest}
        return toml_text(about | {"arguments": self.arguments})

    def roughness(self, name: str) -> str:
        """See `Source.roughness`: empty, since only a test can show a rough dependence."""
        del name
        return ""


def _arguments(
    program: Program, function: Callable[..., Problem], given: Mapping[str, Any]
) -> dict[str, bool | int | float | str | list[Any]]:
    """Values of all arguments of a function, by name. **Raises** CaseError: see `Program`."""
    known = inspect.signature(function).parameters
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    if unnamed := [name for name, one in known.items() if one.kind not in kinds]:
        raise CaseError(
            f"{program.place}: {', '.join(unnamed)} cannot be passed by name; use named arguments only"
        )
    for name in given:
        if name not in known:
            raise CaseError(_unknown(program, name, known))
    found = {}
    for name, one in known.items():
        value = given.get(name, one.default)
        if value is inspect.Parameter.empty:
            raise CaseError(f"{program.place}: {name} is missing; give it as {name}=VALUE, or set a default")
        found[name] = _plain(program, name, value, one.default)
    return found


def _plain(program: Program, name: str, value: Any, default: Any) -> Any:
    """Value in the form in which a file stores it; an integer becomes a float if the default is a float."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(program, name, part, None) for part in value]
    if not isinstance(value, VALUES):
        raise CaseError(
            f"{program.place}: {name} = {value!r} must be a number, a string, true or false, or a list of "
            "these"
        )
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if whole and isinstance(default, float) else value


def _unknown(program: Program, name: str, known: Mapping[str, Any]) -> str:
    """Message for an argument that a function does not have."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    meant = f"; did you mean {near[0]!r}?" if near else ""
    return f"{program.place} has no argument {name!r}{meant} (it has {', '.join(known) or 'none'})"


def _kind(value: Any) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"


def _text_of(function: Callable[..., Problem]) -> bytes:
    """Source text of a function, or its compiled code if Python cannot find the text."""
    try:
        return inspect.getsource(function).encode()
    except (OSError, TypeError):
        code = getattr(function, "__code__", None)
        return b"" if code is None else marshal.dumps(code)


def _place_of(function: Callable[..., Problem]) -> str:
    """Place where another process can import a function, "FILE.py:FUNCTION"; empty if it cannot."""
    file = inspect.getsourcefile(function) if inspect.isfunction(function) else None
    if file is None or not Path(file).is_file() or function.__qualname__ != function.__name__:
        return ""
    return f"{Path(file).resolve()}:{function.__name__}"


def _function_at(place: str) -> Callable[..., Problem]:
    """Function at "FILE.py:FUNCTION"; its file is imported once. **Raises** CaseError as `Program.load`."""
    text, _, name = place.rpartition(":")
    file = Path(text).resolve()
    if not text.endswith(".py") or not name.isidentifier():
        raise CaseError(f"{place!r}: must be FILE.py:FUNCTION, for example buoy.py:buoy")
    if not file.is_file():
        raise CaseError(f"{text}: there is no such file; give FILE.py:FUNCTION with an existing file")
    try:
        module = _loaded.get(str(file)) or _import(file)
    except Exception as error:
        raise CaseError(f"{text}: importing this file raised {type(error).__name__}: {error}") from error
    function = getattr(module, name, None)
    if not inspect.isfunction(function):
        here = [
            n
            for n, one in vars(module).items()
            if inspect.isfunction(one) and one.__module__ == module.__name__
        ]
        near = difflib.get_close_matches(name, here, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise CaseError(f"{text} has no function {name!r}{meant} (it has {', '.join(here) or 'none'})")
    return function


def _import(file: Path) -> ModuleType:
    """Imports a file as a module; the file can import other files in its folder, as a script can."""
    if str(file.parent) not in sys.path:
        sys.path.insert(0, str(file.parent))
    # a unique name: `buoy.py` must not hide an installed module called buoy
    name = f"jaxsph_program_{hashlib.sha256(str(file).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None, "a .py file has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    _loaded[str(file)] = module
    return module
