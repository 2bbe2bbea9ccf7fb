"""Files that a case or a command names: messages never show their content, and only tables are read."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.errors import CaseError

SECRET = "hunter2"

REST = {
    "waves": "dx = 0.1\nt1 = 1.0\n[tank]\nlength = 4.0\ndepth = 0.5\n[waves]\nkind = 'recorded'\n",
    "pto": js.load_case("owc").to_toml().split("[pto]")[0] + "[pto]\n",
    "chamber": "dx = 0.02\nt1 = 1.0\n[tank]\nlength = 4.0\ndepth = 0.5\n"
    "[solid.front.block]\nlow = [3.2, 0.3]\nhigh = [3.3, 0.8]\n"
    "[chamber.air]\nbetween = ['front', 'far']\n[chamber.air.pto]\n",
    "solid": "dx = 0.1\nt1 = 1.0\n[tank]\nlength = 4.0\ndepth = 0.5\n[solid.bed]\n",
    "body": "dx = 0.1\nt1 = 1.0\n[tank]\nlength = 4.0\ndepth = 0.5\n[body]\n",
}
"""Cases up to the section that names a file, by section."""


def of_case(section):
    """Function that reads a data file through a case that names the file."""

    def read(path):
        case = path.parent / "case" / "stranger.toml"
        case.parent.mkdir(exist_ok=True)
        case.write_text(REST[section] + f"file = '../{path.name}'\n")
        return js.load_case(case)

    return read


READERS = {
    "waves.file": of_case("waves"),
    "pto.file": of_case("pto"),
    "chamber.air.pto.file": of_case("chamber"),
    "solid.bed.file": of_case("solid"),
    "body.file": of_case("body"),
    "--table": js.ScatterTable.read,
}
"""All functions that read a data file, by the key or option that names the file."""
HEADERS = {
    "waves.file": "t,eta",
    "pto.file": "q,P_a",
    "chamber.air.pto.file": "q,P_a",
    "solid.bed.file": "x,z",
    "body.file": "x,z",
    "--table": "Hs,Tp,share",
}


def test_a_shape_and_a_curve_come_from_files(tmp_path):
    """For a solid, a body and a named chamber; the case then contains the numbers, not the file's name."""
    corners, curve = [[2.0, 0.0], [3.0, 0.3], [3.0, 0.0]], [[-0.1, -100.0], [0.0, 0.0], [0.1, 100.0]]
    path, other = tmp_path / "shape.csv", tmp_path / "curve.csv"
    path.write_text("x (m),z (m)\n" + "".join(f"{x},{z}\n" for x, z in corners))
    other.write_text("q,P_a\n" + "".join(f"{q},{P_a}\n" for q, P_a in curve))
    solid, body = of_case("solid")(path), of_case("body")(path)
    assert solid.solid["bed"].polygon == body.body.polygon == tuple(map(tuple, corners))
    assert of_case("chamber")(other).chamber["air"].pto.curve == tuple(map(tuple, curve))
    assert "shape.csv" not in solid.to_toml()


def refusal(key, path):
    """Message of the refusal of a file."""
    with pytest.raises(CaseError) as caught:
        READERS[key](path)
    return str(caught.value)


SHAPES = (
    "{s}",
    "PATH={s}\0HOME=/root",
    "{s},{s}\n1,2",
    "{h}\n1,{s}",
    "{h}\n{s}",
    '{h}\n1,"{s}',
    '{h}\n"1" {s},2',
    "{h},{s}\n1,2,3",
    "t ({s}),eta\n1,2",
    "q ({s}),P_a\n1,2",
    "Hs ({s}),Tp,share\n1,2,1",
    "t;eta;{s}\n",
)
"""Contents of files, with a secret in various places."""


@pytest.mark.parametrize("key", READERS)
@pytest.mark.parametrize("shape", SHAPES)
def test_no_message_shows_what_a_file_holds(tmp_path, key, shape):
    path = tmp_path / "environ.csv"
    path.write_text(shape.format(s=SECRET, h=HEADERS[key]))
    assert SECRET not in refusal(key, path)


@pytest.mark.parametrize("key", READERS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(before=st.binary(max_size=40), after=st.binary(max_size=40), headed=st.booleans())
def test_no_bytes_around_a_secret_make_a_message_show_it(tmp_path, key, before, after, headed):
    path = tmp_path / "environ.csv"
    head = (HEADERS[key] + "\n").encode() if headed else b""
    path.write_bytes(head + before + SECRET.encode() + after)
    assert SECRET not in refusal(key, path)


def _fill(path, kind):
    """Creates something that is not a table, of the kind `kind`."""
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "large":
        path.write_text("t,eta\n" + "0.1,0.2\n" * 200_000)
    elif kind == "NUL":
        path.write_bytes(b"t,eta\n0,\x000\n")
    elif kind == "UTF-16":
        path.write_text("t,eta\n0,0\n", encoding="utf-16")


@pytest.mark.parametrize("key", READERS)
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("fifo", "a pipe or a device"),
        ("folder", "folder"),
        ("device", "a pipe or a device"),
        ("large", r"too large for a data file, which may have at most 1e\+06 bytes"),
        ("NUL", "is a NUL byte"),
        ("UTF-16", "is not UTF-8 text"),
        ("absent", "no data file .*give the name of a CSV file"),
        ("environ", "name ends in .csv"),
    ],
)
def test_only_tables_are_read(tmp_path, key, kind, words):
    path = tmp_path / ("environ" if kind == "environ" else f"{kind}.csv")
    _fill(path, kind)
    with pytest.raises(CaseError, match=words):
        READERS[key](path)


def test_the_command_line_shows_nothing_of_the_environment(tmp_path):
    case = tmp_path / "stranger.toml"
    up = "../" * len(tmp_path.parts)
    case.write_text(REST["waves"] + f"file = '{up}proc/self/environ'\n")
    done = subprocess.run(
        [sys.executable, "-m", "jaxsph", "check", str(case)],
        env={"A_SECRET": SECRET} | os.environ,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2 and "must be a CSV file" in done.stderr
    assert SECRET not in done.stdout + done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("section", REST)
@pytest.mark.parametrize("name", ["3", "['a.csv']", "'a\\u0000.csv'", "''"])
def test_a_name_that_is_none_is_refused(tmp_path, section, name):
    (tmp_path / "mine.toml").write_text(REST[section] + f"file = {name}\n".replace("'", '"'))
    with pytest.raises(CaseError, match=r"CSV|cannot be read"):
        js.load_case(tmp_path / "mine.toml")


def test_a_message_says_where_the_fault_is(tmp_path):
    """It gives the number and the length of the line, and what the line must contain."""
    path = tmp_path / "sea.csv"
    path.write_text('t (s),eta (m)\n\n0,"0\n1"\n')
    message = refusal("waves.file", path)
    assert message.endswith(
        "sea.csv, line 3 (6 characters): must have 2 finite numbers (t, eta), separated by commas"
    )


def test_spreadsheets_write_a_mark_before_the_first_name(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Hs,Tp,share\r\n0.02,1.2,1\r\n", encoding="utf-8-sig")
    assert js.ScatterTable.read(path).Hs.tolist() == [0.02]


def test_there_is_one_reader_of_tables():
    """No other file of the package parses a CSV file or a text of numbers."""
    readers = {"csv.reader", "csv.DictReader", "loadtxt", "genfromtxt", "fromfile", "read_csv"}
    for path in Path(js.__file__).parent.rglob("*.py"):
        if path.name == "data_files.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        called = [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]
        found = [one for one in called if one in readers or one.rpartition(".")[2] in readers]
        assert not found, path
