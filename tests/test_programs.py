"""Compiled programs are forgotten before they use up a process's memory maps."""

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
