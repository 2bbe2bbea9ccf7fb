"""Numbers in prose that are taken from the committed results."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from experiments.common import COMMITTED

NUMBER = r"[+-]?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?"
"""Pattern of a printed number with its sign."""


class Results:
    """Rows of the committed results."""

    def __init__(self, folder: Path = COMMITTED) -> None:
        self._folder = folder
        self._rows: dict[str, list[dict[str, Any]]] = {}

    def __call__(self, name: str, check: str, after: str | None = None, column: str = "here") -> float:
        """Value of the first row `check` in the results `name`, or of the first such row below row `after`.

        **Raises** KeyError if there is no such row.
        """
        rows = self.rows(name)
        labels = [row["check"] for row in rows]
        if after is not None and after not in labels:
            raise KeyError(f"{name} has no row {after!r}")
        start = 0 if after is None else labels.index(after) + 1
        if check not in labels[start:]:
            raise KeyError(f"{name} has no row {check!r}" + (f" below {after!r}" if after else ""))
        return rows[labels.index(check, start)][column]

    def rows(self, name: str, beginning: str = "") -> list[dict[str, Any]]:
        """Rows of the results `name` whose checks begin with `beginning`."""
        if name not in self._rows:
            text = (self._folder / f"{name}.json").read_text(encoding="utf-8")
            self._rows[name] = json.loads(text)["rows"]
        return [row for row in self._rows[name] if row["check"].startswith(beginning)]


class Sentence(NamedTuple):
    """Part of a sentence with numbers from the results."""

    text: str
    """Words of the sentence, with a format field in place of each number. Line breaks count as spaces."""
    numbers: Callable[[Results], tuple[float, ...]]
    """Function that reads the numbers from the results, in the order of the format fields."""
    pages: tuple[str, ...]
    """Paths of the pages that contain the sentence, relative to the project's folder."""


def renewed(page: str, text: str, results: Results, sentences: tuple[Sentence, ...]) -> str:
    """The text of a page with the present numbers inserted.

    **Raises** ValueError unless each of the page's sentences is in the text exactly once.
    """
    for sentence in sentences:
        if page in sentence.pages:
            text = _renewed(sentence, text, page, results)
    return text


def _renewed(sentence: Sentence, text: str, page: str, results: Results) -> str:
    words = re.split(r"(\{[^}]*\})", sentence.text)
    pattern = "".join(
        f"({NUMBER})" if n % 2 else r"\s+".join(re.escape(part) for part in word.split(" "))
        for n, word in enumerate(words)
    )
    found = list(re.finditer(pattern, text))
    if len(found) != 1:
        raise ValueError(f"{page} has {sentence.text!r} {len(found)} times: it must occur once")
    numbers = [form.format(value) for form, value in zip(words[1::2], sentence.numbers(results), strict=True)]
    for group in range(len(numbers), 0, -1):
        start, end = found[0].span(group)
        text = text[:start] + numbers[group - 1] + text[end:]
    return text
