"""Compiled programs are forgotten before a process has no memory maps left for another one."""

import jax
import jax.numpy as jnp
import pytest

from jaxsph.core import programs
from jaxsph.run import chunks


@pytest.fixture
def listed(tmp_path, monkeypatch):
    """Function that pretends that the process has `count` memory maps of `limit`."""

    def pretend(count, limit):
        maps, most = tmp_path / "maps", tmp_path / "limit"
        maps.write_bytes(b"00400000-00452000 r-xp\n" * count)
        most.write_text(f"{limit}\n", encoding="ascii")
        monkeypatch.setattr(programs, "MAPS", maps)
        monkeypatch.setattr(programs, "LIMIT", most)

    return pretend


@pytest.fixture
def doubled(monkeypatch):
    """A compiled function; the caches of all others are kept."""
    function = jax.jit(lambda x: 2.0 * x)
    monkeypatch.setattr(jax, "clear_caches", function.clear_cache)
    function(jnp.ones(3))
    assert function._cache_size() == 1
    return function


@pytest.mark.parametrize(("count", "left"), [(499, 1), (501, 0)])
def test_programs_are_forgotten_beyond_half_of_the_maps(listed, doubled, count, left):
    listed(count, 1000)
    programs.forget_programs()
    assert doubled._cache_size() == left


def test_every_chunk_makes_room(listed, doubled):
    listed(600, 1000)
    with pytest.raises(ZeroDivisionError):
        chunks.replay_chunk(None, lambda model: 1 / 0, print)
    assert doubled._cache_size() == 0


def test_without_the_lists_nothing_is_forgotten(doubled, monkeypatch, tmp_path):
    monkeypatch.setattr(programs, "MAPS", tmp_path / "none")
    programs.forget_programs()
    assert doubled._cache_size() == 1


def test_a_program_takes_maps_and_gives_them_back():
    """The cause: without it the functions above would have no purpose."""
    if not programs.MAPS.exists():
        pytest.skip("only Linux lists the memory maps")

    def count():
        return len(programs.MAPS.read_bytes().splitlines())

    before = count()
    function = jax.jit(lambda x: [jnp.sort(x + k) for k in range(20)])
    function(jnp.ones(100))
    taken = count() - before
    function.clear_cache()
    assert taken > 20
    assert count() - before < 0.5 * taken
