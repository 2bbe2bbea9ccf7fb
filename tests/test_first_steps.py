"""First steps of a user: a coarse run, a commented case file, completion of names."""

import tomllib

import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.case.case import key_names
from jaxsph.case.commented import commented_toml, keys_of, sections_of
from jaxsph.case.sections import Sections
from jaxsph.case.settling import settled_periods
from jaxsph.cli.app import app
from jaxsph.errors import CaseError

CASES = sorted(js.built_in_cases())


def _jaxsph(*arguments, **environment):
    return CliRunner().invoke(app, list(arguments), prog_name="jaxsph", env=environment)


@pytest.mark.parametrize("name", sorted(set(CASES) - {"dam_break_column"}))
def test_coarse_case_is_coarser_and_no_longer_and_says_so(name):
    case = js.load_case(name)
    coarse = js.coarsen(case)
    assert 1.5 * case.dx <= coarse.dx <= 2.0 * case.dx and coarse.t1 <= case.t1
    assert coarse.name == f"{name}_quick" and coarse.description.startswith("COARSE")
    assert coarse.output.snapshot_dt == case.output.snapshot_dt  # as many snapshots per second
    if case.waves is not None and case.waves.kind == "regular" and coarse.t1 < case.t1:
        assert settled_periods(coarse, coarse.t1 - coarse.output.sample_dt) == 5


def test_what_cannot_be_coarser_says_why():
    said = r"cannot be run with dx increased from 0.02 m by a factor of 2, 1.5 or 1.25 "
    with pytest.raises(CaseError, match=said + r"\(tank.layer = 0.01 m does not fit"):
        js.coarsen(js.load_case("dam_break_column"))


def test_a_narrow_chamber_is_told_of():
    assert not any("chamber_length" in notice for notice in js.load_case("owc").notices())
    notices = js.coarsen(js.load_case("owc")).notices()
    assert any("device.chamber_length = 0.13 m is only 3.2 spacings long" in notice for notice in notices)


@pytest.mark.parametrize("name", CASES)
def test_commented_file_is_the_case(name):
    case = js.load_case(name)
    text = commented_toml(case)
    assert js.Case.from_dict(tomllib.loads(text) | {"name": name}) == case
    assert max(map(len, text.splitlines())) <= 120 or "description" in text


def test_every_key_is_in_a_table_with_its_meaning():
    tables = {"": keys_of(Sections)} | {name: keys_of(section) for name, section in sections_of().items()}
    named = {f"{name.split(' ')[0]}.{key.name}".lstrip(".") for name, keys in tables.items() for key in keys}
    sections = {name.split(" ")[0] for name in tables}
    assert set(key_names(Sections)) - sections == named
    assert not [f"{name}.{key.name}" for name, keys in tables.items() for key in keys if not key.meaning]
    allowed = {key.name: key.allowed for key in tables["tank"]}
    assert allowed["length"] == allowed["width"] == "number from 1e-05 to 100000"
    assert allowed["rim"] == '"closed" or "open"'


def test_new_writes_a_case_that_runs_and_never_over_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = _jaxsph("new", "mine", "--like", "owc_irregular")
    assert result.exit_code == 0 and "jaxsph run mine.toml" in result.stdout
    assert js.load_case("mine.toml").waves.kind == "irregular"
    result = _jaxsph("new", "mine")
    assert result.exit_code == 2 and "mine.toml already exists" in result.stderr
    result = _jaxsph("new", "other", "--like", "ow")
    assert result.exit_code == 2 and "did you mean 'owc'" in result.stderr


def test_shells_complete_cases_and_keys(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "owner.toml").write_text("")

    def completed(*words):
        return _jaxsph(
            _JAXSPH_COMPLETE="complete_bash", COMP_WORDS=" ".join(words), COMP_CWORD=str(len(words) - 1)
        ).stdout.split()

    assert completed("jaxsph", "run", "ow") == [
        *sorted(n for n in js.built_in_cases() if n.startswith("ow")),
        "owner.toml",
    ]
    assert completed("jaxsph", "run", "owc", "--set", "waves.H") == ["waves.H=", "waves.Hs="]
