"""Compiled programs are forgotten before they use up a process's memory maps."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
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


def test_of_threads_that_come_at_once_one_compiles(monkeypatch):
    """The others wait until it has; afterwards nobody waits."""
    monkeypatch.setattr(programs, "_compiled", set())
    events, started = [], threading.Barrier(4)

    def call(number):
        started.wait(10.0)
        with programs.compiled_once("key"):
            events.append(("begins", number))
            time.sleep(0.1)
            events.append(("ends", number))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(call, range(4)))
    first = events[0][1]
    assert events[:2] == [("begins", first), ("ends", first)]
    assert len(events) == 8 and "key" in programs._compiled


def test_a_call_that_fails_leaves_the_next_to_compile(monkeypatch):
    monkeypatch.setattr(programs, "_compiled", set())
    with pytest.raises(ZeroDivisionError), programs.compiled_once("key"):
        _ = 1 / 0
    assert "key" not in programs._compiled
    with programs.compiled_once("key"):
        pass
    assert "key" in programs._compiled
