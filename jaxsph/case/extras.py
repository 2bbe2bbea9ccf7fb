"""Imports of optional libraries."""

from __future__ import annotations

import importlib
from types import ModuleType

from jaxsph.errors import CaseError


def library(name: str, extra: str, what: str) -> ModuleType:
    """Imports the library `name` of an extra; `what` needs this library, for example "a drawing".

    **Raises** CaseError if the library is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise CaseError(
            f"{what} needs {name.split('.')[0]}, which is not installed: run pip install 'jaxsph[{extra}]'"
        ) from None
