"""TOML text of nested values."""

from __future__ import annotations

import json
from typing import Any


def toml_text(data: dict[str, Any], prefix: str = "") -> str:
    """TOML text of a mapping; the mappings in it become tables."""
    own = [f"{k} = {toml_value(v)}" for k, v in data.items() if not isinstance(v, dict)]
    text = "\n".join(own) + "\n" if own else ""
    for key, value in data.items():
        if isinstance(value, dict) and value:
            # a table that contains only tables needs no header
            header = "" if all(isinstance(v, dict) and v for v in value.values()) else f"\n[{prefix}{key}]\n"
            text += header + toml_text(value, f"{prefix}{key}.")
    return text


def toml_value(value: Any) -> str:
    """Value as TOML text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return repr(value)
