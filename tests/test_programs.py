"""Compiled programs outlive a process, and are forgotten before they use up its memory maps."""

import threading
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax import programs


@pytest.fixture
def doubled():
    @jax.jit
    def doubled(x):
        return 2.0 * x

    doubled(jnp.zeros(3))
    return doubled


@pytest.fixture
def told(monkeypatch, tmp_path):
    """Pretend a number of maps of a hundred that are allowed."""

    def tell(held: int) -> None:
        (tmp_path / "maps").write_text("one\n" * held)
        (tmp_path / "limit").write_text("100\n")
        monkeypatch.setattr(programs, "_MAPS", tmp_path / "maps")
        monkeypatch.setattr(programs, "_LIMIT", tmp_path / "limit")

    return tell


def test_programs_stay_while_there_is_room(doubled, told):
    told(49)
    programs.make_room()
    assert doubled._cache_size() == 1


def test_programs_are_forgotten_where_maps_run_out(doubled, told):
    told(51)
    programs.make_room()
    assert doubled._cache_size() == 0
    assert doubled(jnp.ones(3)).tolist() == [2.0] * 3


def test_a_system_that_does_not_tell_is_left_alone(doubled, monkeypatch, tmp_path):
    monkeypatch.setattr(programs, "_MAPS", tmp_path / "none")
    programs.make_room()
    assert doubled._cache_size() == 1


class Pair(eqx.Module):
    one: jax.Array
    two: jax.Array
    by: int = eqx.field(static=True, default=1)


class Counted:
    """A function that counts how often it is traced, and needs LAPACK."""

    __module__ = "tests"

    def __init__(self):
        self.traced = 0
        self.__qualname__ = "counted"

    def __call__(self, pair: Pair, more: programs.Static) -> Pair:
        self.traced += 1
        inverse = jnp.linalg.inv(pair.one)
        return Pair(inverse @ pair.two, more.value * pair.two, pair.by + 1)


@pytest.fixture
def folder(tmp_path):
    """A compilation cache, which JAX has in use."""
    before = programs._SETTINGS.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "programs"
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def nowhere(monkeypatch):
    """No compilation cache, which the tests may share."""
    monkeypatch.setattr(programs, "_file", lambda name, arguments: None)


PAIR = Pair(2.0 * jnp.eye(2), jnp.ones(2))


def right(found: Pair, by: float, n: int = 2) -> bool:
    return found.by == n and found.one.tolist() == [0.5] * 2 and found.two.tolist() == [by] * 2


def test_a_program_outlives_the_function_that_made_it(folder):
    first, second = Counted(), Counted()
    assert right(programs.Kept(first)(PAIR, programs.Static(3.0)), 3.0)
    assert right(programs.Kept(second)(PAIR, programs.Static(3.0)), 3.0)
    assert (first.traced, second.traced) == (1, 0)
    (file,) = folder.iterdir()
    assert file.name.startswith("tests.counted-")


def test_what_is_static_or_has_another_shape_gets_a_program_of_its_own(folder):
    counted = Counted()
    kept = programs.Kept(counted)
    assert right(kept(PAIR, programs.Static(3.0)), 3.0)
    assert right(kept(PAIR, programs.Static(4.0)), 4.0)
    assert right(kept(Pair(PAIR.one, PAIR.two, 2), programs.Static(4.0)), 4.0, 3)
    assert kept(Pair(jnp.eye(3), jnp.ones(3)), programs.Static(4.0)).one.shape == (3,)
    assert right(kept(PAIR, programs.Static(3.0)), 3.0)
    assert counted.traced == 4 and len(list(folder.iterdir())) == 4


def test_a_file_that_cannot_be_read_is_written_anew(folder):
    programs.Kept(Counted())(PAIR, programs.Static(3.0))
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:100])
    counted = Counted()
    assert right(programs.Kept(counted)(PAIR, programs.Static(3.0)), 3.0)
    assert counted.traced == 1 and len(file.read_bytes()) > 1000


def test_nothing_is_kept_where_no_cache_is_in_use(folder, nowhere):
    assert right(programs.Kept(Counted())(PAIR, programs.Static(3.0)), 3.0)
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_keeps_nothing(folder):
    folder.write_text("a file in its place")
    assert right(programs.Kept(Counted())(PAIR, programs.Static(3.0)), 3.0)


@pytest.mark.parametrize("place", [None, "gs://bucket/cache"])
def test_a_cache_that_is_no_folder_keeps_nothing(folder, place):
    jax.config.update("jax_compilation_cache_dir", place)
    assert programs._file("name", "arguments") is None


def test_other_sources_ask_for_another_file(folder, monkeypatch):
    here = programs._file("name", "arguments")
    assert here == programs._file("name", "arguments")
    monkeypatch.setattr(programs, "_surroundings", lambda: "another version")
    assert here != programs._file("name", "arguments")


def test_of_threads_that_come_at_once_one_makes_the_program(nowhere):
    counted, started = Counted(), threading.Barrier(4)
    kept = programs.Kept(counted)

    def call(_):
        started.wait(10.0)
        return right(kept(PAIR, programs.Static(3.0)), 3.0)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(call, range(4)))
    assert counted.traced == 1


def test_a_program_has_the_precision_of_its_arguments_in_any_thread(nowhere):
    """The setting of JAX for it is a thread's own, and another may make the program."""
    kept = programs.Kept(lambda x: x + jnp.arange(3.0))
    with jax.enable_x64(False):
        single = jnp.ones(3)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(kept, single).result().dtype == np.float32
        assert pool.submit(kept, jnp.ones(3)).result().dtype == np.float64


def test_a_call_that_fails_leaves_the_next_to_make_it(nowhere):
    kept = programs.Kept(Counted())
    with pytest.raises(TypeError):
        kept(PAIR, programs.Static("no number"))
    assert right(kept(PAIR, programs.Static(3.0)), 3.0)


def test_kept_programs_are_forgotten_where_maps_run_out(told, nowhere):
    counted = Counted()
    kept = programs.Kept(counted)
    kept(PAIR, programs.Static(3.0))
    told(51)
    programs.make_room()
    assert right(kept(PAIR, programs.Static(3.0)), 3.0) and counted.traced == 2
