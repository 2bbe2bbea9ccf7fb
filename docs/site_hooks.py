"""Pages of the documentation that are generated from code and results, and formulas as MathML.

MkDocs calls the `on_*` functions. The pages on keys of a case, commands, results, public names, examples and
evidence are generated, so that they cannot differ from the program.
"""

from __future__ import annotations

import html
import inspect
import re
import sys
from pathlib import Path

import latex2mathml.converter
import typer
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the experiments are not part of the installed package

import jaxsph  # noqa: E402
from experiments import __main__ as experiments  # noqa: E402
from experiments import prose, sentences  # noqa: E402
from experiments.common import VERDICT, shown  # noqa: E402
from jaxsph.case.commented import Key, keys_of, sections_of  # noqa: E402
from jaxsph.case.sections import Sections  # noqa: E402
from jaxsph.cli.app import app  # noqa: E402
from jaxsph.report.content import PANELS  # noqa: E402
from jaxsph.report.labels import LABELS  # noqa: E402

ABOUT = {
    "verification": "against exact solutions, and states that must not change",
    "validation": "against measurements and other codes",
    "studies": "what the method does, and what it depends on",
    "benchmarks": "time and memory",
}
"""Folders of the experiments, and what each contains."""


def on_files(files, config):
    """Adds the generated pages, and the pictures that they show."""
    made = {
        "reference/keys.md": keys_page(),
        "reference/commands.md": commands_page(),
        "reference/results.md": results_page(),
        "reference/api.md": api_page(),
        "reference/examples.md": examples_page(),
        "contributing.md": (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"),
        "changes.md": (ROOT / "CHANGES.md").read_text(encoding="utf-8"),
        **evidence_pages(),
    }
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    for picture in sorted((ROOT / "experiments" / "results").glob("*.png")):
        files.append(File.generated(config, f"evidence/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Inserts examples where they are named, and the present numbers; leads links to files outside docs to
    the pages generated from these files."""
    markdown = prose.renewed(f"docs/{page.file.src_uri}", markdown, prose.Results(), sentences.PROSE)
    markdown = re.sub(r"<!-- example: (\w+) -->", lambda found: _fenced(found[1]), markdown)
    up = "../" * page.file.src_uri.count("/")
    markdown = re.sub(
        r"\]\((?:\.\./)+examples/?(?:(\w+)\.py)?\)",
        lambda found: f"]({up}reference/examples.md" + (f"#{found[1]}" if found[1] else "") + ")",
        markdown,
    )
    markdown = re.sub(r"\]\((?:\.\./)+experiments(?:/README\.md)?\)", f"]({up}evidence/index.md)", markdown)
    return re.sub(r"\]\(docs/([\w/-]+\.(?:md|png))\)", r"](\1)", markdown)


def on_page_content(content, page, config, files):
    """Converts formulas to MathML, which browsers draw without a script."""

    def mathml(found):
        block = found[1] == "div"
        formula = html.unescape(found[2]).strip()[2:-2]
        formula = re.sub(r"\\mathbf ?(\\?[A-Za-z]+)", r"\\mathbf{\1}", formula)
        drawn = latex2mathml.converter.convert(formula, display="block" if block else "inline")
        return re.sub(r'<mi mathvariant="bold">(?:&#x(\w+);|(.))</mi>', _bold, drawn)

    return re.sub(r'<(div|span) class="arithmatex">(.*?)</\1>', mathml, content, flags=re.DOTALL)


def _bold(found: re.Match[str]) -> str:
    """Bold letter as a separate Unicode character, because browsers draw no other bold letters in MathML."""
    letter = chr(int(found[1], 16)) if found[1] else found[2]
    for first, last, bold in (("a", "z", 0x1D41A), ("A", "Z", 0x1D400), ("\u0391", "\u03a9", 0x1D6A8)):
        if first <= letter <= last:
            letter = chr(bold + ord(letter) - ord(first))
    return f'<mi mathvariant="normal">{letter}</mi>'


# --- reference


def keys_page() -> str:
    """Every key of a case file, by section."""
    parts = [
        "# Keys of a case\n",
        "All values are in SI units. The allowed values of a key are defined in `jaxsph/case`; lengths and "
        "times are also checked against each other when a case is read. `jaxsph new NAME` writes a case file "
        "that contains all keys, as comments.\n",
        "## Top level\n",
        _key_table([key for key in keys_of(Sections)]),
    ]
    for name, section in sections_of().items():
        plain, _, kind = name.partition(" ")
        parts += [f"## [{plain}]{' ' if kind else ''}{kind.strip('()')}\n", inspect.getdoc(section) + "\n"]
        parts.append(_key_table(keys_of(section)))
    return "\n".join(parts)


def _key_table(keys: list[Key]) -> str:
    rows = ["| key | allowed values | default | meaning |", "|---|---|---|---|"]
    for key in keys:
        default = f"`{key.default}`" if key.default else ""
        rows.append(f"| `{key.name}` | {key.allowed} | {default} | {_cell(key.meaning)} |")
    return "\n".join(rows) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def commands_page() -> str:
    """Every command with its arguments and options, with the help texts of the program."""
    parts = ["# Command line\n", "`jaxsph COMMAND --help` prints these texts in a terminal.\n"]
    for name, command in typer.main.get_command(app).commands.items():
        parts += [f"## jaxsph {name}\n", (command.help or "").strip() + "\n"]
        parts += ["| argument or option | meaning |", "|---|---|"]
        for one in command.params:
            if one.name == "help":
                continue
            names = ", ".join(f"`{text}`" for text in [*one.opts, *one.secondary_opts])
            if one.param_type_name == "argument":
                names = f"`{one.metavar or one.name.upper()}`"
            parts.append(f"| {names} | {_cell(getattr(one, 'help', '') or '')} |")
        parts.append("")
    return "\n".join(parts)


def results_page() -> str:
    """Scalar results of a run, and its readings over time."""
    parts = [
        "# Results and readings\n",
        "The file of a run contains the readings over time in the group `series`, each with its unit and "
        "description, and the results below, which the terminal and the page of the run also show. Energies "
        "and powers of two-dimensional cases are per metre of width.\n",
        "## Results\n",
        "| name | result | unit (2-D) | meaning |",
        "|---|---|---|---|",
    ]
    parts += [f"| `{n}` | {one.text.strip()} | {one.unit} | {one.meaning} |" for n, one in LABELS.items()]
    parts.append(
        "\nQuantities that oscillate in regular waves have further results: `amplitude_NAME` is the "
        "amplitude of the first harmonic, `mean_NAME` the mean, and `rao_NAME` the amplitude divided by the "
        "wave amplitude ([what comes out](../cases.md#what-comes-out)). `linear_RESULT` is the value of "
        "RESULT by linear theory.\n"
    )
    parts += ["\n## Readings over time\n", "| name | reading |", "|---|---|"]
    parts += [f"| `{name}` | {title} |" for name, title in PANELS.items()]
    parts.append(
        "\nWith several chambers or bodies, the name of a reading ends in the name of its chamber or body.\n"
    )
    return "\n".join(parts)


def api_page() -> str:
    """Public names by subpackage, with their docstrings."""
    parts = [
        "# Python\n",
        "All public names are available after `import jaxsph as js`. The first line of a docstring names the "
        "quantity with its unit. Shapes are in brackets: `[N, D]` means N particles in D dimensions.\n",
    ]
    for room, names in jaxsph._ROOMS.items():
        parts.append(f"## {room}\n")
        parts += [f"::: jaxsph.{room}.{name}\n" for name in names]
    return "\n".join(parts)


def examples_page() -> str:
    """Examples, with the complete text of each file."""
    parts = ["# Examples\n", "Short scripts to copy, from the folder `examples`; a test runs each of them.\n"]
    for path in sorted((ROOT / "examples").glob("*.py")):
        parts += [f"## {path.stem}\n", _fenced(path.stem) + "\n"]
    return "\n".join(parts)


def _fenced(example: str) -> str:
    text = (ROOT / "examples" / f"{example}.py").read_text(encoding="utf-8")
    return f"```python\n{text}```"


# --- evidence


def evidence_pages() -> dict[str, str]:
    """Committed results, a page for each folder of experiments: limits, values, pictures, commands."""
    of = {name: path.parent.name for name, path in experiments.experiments().items()}
    found = {folder: [] for folder in ABOUT}
    for one in experiments.results():
        found[of[one["command"].split()[4]]].append(one)
    pages = {f"evidence/{name}.md": _evidence_page(name, results) for name, results in found.items()}
    return pages | {"evidence/index.md": _evidence_index(found)}


def _evidence_index(found: dict[str, list]) -> str:
    parts = [
        "# Evidence\n",
        "These pages are generated from the committed results. The command above each table printed its "
        "values. A row gives the limit of the check; a value outside its limit is bold and marked MISSED. "
        "The reference is the value of theory, or of the measurement, program or run with which a value is "
        "compared. "
        "The [table of checks](../checks.md) orders the checks by subject.\n",
        "| | experiments | rows | rows with a limit | outside their limits |",
        "|---|---|---|---|---|",
    ]
    for folder, results in found.items():
        rows = [row for one in results for row in one["rows"]]
        barred = [row for row in rows if row["passes"] is not None]
        missed = sum(row["passes"] is False for row in barred)
        counts = " | ".join(str(count) for count in (len(results), len(rows), len(barred), missed))
        parts.append(f"| [{folder}]({folder}.md): {ABOUT[folder]} | {counts} |")
    return "\n".join(parts) + "\n"


def _evidence_page(folder: str, results: list[dict]) -> str:
    parts = [f"# {folder.capitalize()}\n", f"{ABOUT[folder].capitalize()}.\n"]
    for one in results:
        heading = one["title"] + ("" if one["dx"] is None else f", dx = {one['dx']:g} m")
        parts += [
            f"## {heading}\n",
            f"`{one['command']}` ({one['seconds'] / 60:.1f} min; {one['machine']})\n",
        ]
        parts += ["| check | here | reference | paper | limit | |", "|---|---|---|---|---|---|"]
        for row in one["rows"]:
            value = shown(row["here"], row["unit"])
            value = f"**{value}**" if row["passes"] is False else value
            cells = [row["check"], value, shown(row["theory"]), shown(row["paper"]), row["bar"]]
            parts.append("| " + " | ".join(_cell(cell) for cell in [*cells, VERDICT[row["passes"]]]) + " |")
        parts.append("")
        parts += [f"![{one['title']}, picture {k + 1}]({name})\n" for k, name in enumerate(one["pictures"])]
    return "\n".join(parts)
