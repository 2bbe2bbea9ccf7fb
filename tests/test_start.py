"""Settings before JAX is imported: where compiled programs are stored, and how many of them."""

import os
import subprocess
import sys

import pytest

from jaxsph.start import remove_oldest

TOLD = "import os; print(os.environ.get('JAX_COMPILATION_CACHE_DIR'), jax.config.jax_compilation_cache_dir)"


def started(program, cache, **more):
    """Words printed by a program that is started with its own cache folder."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "TF_CPP"))}
    environment |= {"XDG_CACHE_HOME": str(cache), "HOME": str(cache)} | more
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.skipif(sys.platform != "linux", reason="the folder is named by a variable of Linux")
@pytest.mark.parametrize("order", ["import jaxsph, jax; ", "import jax, jaxsph; "])
def test_programs_are_kept_whichever_is_imported_first(tmp_path, order):
    work = "import jax.numpy as jnp; jax.jit(lambda a: a + 1)(jnp.ones(3)); "
    environment, config = started(order + work + TOLD, tmp_path)
    assert environment == config and environment.startswith(str(tmp_path / "jaxsph" / "compiled"))
    assert os.listdir(config)


@pytest.mark.skipif(sys.platform != "linux", reason="the folder is named by a variable of Linux")
def test_a_folder_of_ones_own_stays_and_one_that_cannot_be_made_is_none(tmp_path):
    told = started("import jaxsph, jax; " + TOLD, tmp_path, JAX_COMPILATION_CACHE_DIR=str(tmp_path / "mine"))
    assert told == [str(tmp_path / "mine")] * 2
    given = f"import jax; jax.config.update('jax_compilation_cache_dir', {str(tmp_path / 'given')!r}); "
    assert started(given + "import jaxsph; " + TOLD, tmp_path) == ["None", str(tmp_path / "given")]
    (tmp_path / "file").touch()
    assert started("import jaxsph, jax; " + TOLD, tmp_path / "file") == ["None", "None"]


def test_the_oldest_go_when_there_are_too_many(tmp_path):
    for k in range(10):
        path = tmp_path / f"{k}"
        path.write_bytes(bytes(100))
        os.utime(path, (k, k))
    remove_oldest(tmp_path, 1000)
    assert len(os.listdir(tmp_path)) == 10
    remove_oldest(tmp_path, 500)
    assert sorted(os.listdir(tmp_path)) == ["6", "7", "8", "9"]
    remove_oldest(tmp_path / "absent", 0)
