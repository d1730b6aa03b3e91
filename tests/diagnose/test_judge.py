"""What causes are worth on data held out."""

from dataclasses import replace

import numpy as np
import pytest

from lasting_errors import (
    DT,
    EVERYWHERE,
    NOISE,
    RESPONSE,
    N,
    T,
)
from vdmsi_jax.diagnose.answer.result import Gain
from vdmsi_jax.diagnose.search.judge import Scored, Trial, confirmed, gain_of


def trial(before, after, y):
    scored = Scored("v", y, before, after, np.zeros(1))
    worth, variance = confirmed(scored, EVERYWHERE, DT)
    return worth, worth / np.sqrt(variance)


def test_a_gain_in_every_block_is_steadier_than_the_same_gain_in_one():
    y = RESPONSE + NOISE
    everywhere = 0.02 * np.sin(2 * np.pi * T / 3.0)[None]
    once = np.where(T < 5.0, 1.0, 0.0)[None] * everywhere * np.sqrt(60.0 / 5.0)
    steady, sudden = (trial(RESPONSE + e, RESPONSE, y) for e in (everywhere, once))
    assert steady[0] > 0.0 and sudden[0] > 0.0
    assert steady[1] > 3.0 > 2.0 > sudden[1]


@pytest.mark.parametrize(
    ("share", "steady", "puzzling", "named"),
    [(0.1, 4.0, False, True), (0.1, 1.0, False, False), (0.5, 1.0, False, True),
     (0.5, 1.0, True, False), (0.95, 1.0, True, True), (0.5, 4.0, True, True)],
)  # fmt: skip
def test_a_name_must_take_more_where_much_is_left(share, steady, puzzling, named):
    gain = Gain("v", 90.0, 90.5, 10.0, 1.0, 0.9)
    assert Trial(gain, None, 50.0, steady, fast=0.9).believed(share, puzzling) is named


@pytest.mark.parametrize(
    ("share", "steady", "named"), [(0.4, 1.0, False), (0.6, 1.0, True), (0.1, 2.5, True)]
)
def test_beside_a_disturbance_a_name_must_take_most_or_hold(share, steady, named):
    gain = Gain("v", 90.0, 90.5, 10.0, 1.0, 0.9)
    assert Trial(gain, None, 50.0, steady, fast=0.9).believed(share, False, disturbed=True) is named


@pytest.mark.parametrize(
    ("fast", "se", "named"), [(0.9, 1.0, True), (0.1, 1.0, False), (0.9, 9.0, False)]
)
def test_what_is_fast_does_not_stand_in_for_a_slow_error(fast, se, named):
    gain = Gain("delta", 80.0, 88.0, se, 1.0, 0.4)
    assert Trial(gain, None, 50.0, 1.0, fast).believed(0.6, puzzling=True) is named


def test_data_that_hardly_show_a_cause_do_not_speak_against_it():
    y, fitted = RESPONSE + NOISE, (T < 40.0)[None]
    effect = np.where(fitted, 0.2, 0.004) * np.sin(2 * np.pi * T / 0.7)[None]
    shown = Scored("v", y, RESPONSE - effect, RESPONSE, np.zeros(1))
    assert shown.faint(fitted, ~fitted) and not shown.faint(~fitted, fitted)
    gain = Gain("v", 90.0, 90.1, 0.1, 1.0, 0.9)
    weak = Trial(gain, None, 10.0, 1.0, fast=0.9)
    assert not weak.believed(0.1, puzzling=False)
    assert replace(weak, faint=True).believed(0.1, puzzling=False)
    assert not replace(weak, faint=True).believed(0.1, puzzling=True)


def test_what_makes_errors_that_last_says_the_same_over_and_over():
    """A change that lasts a quarter of the data is four of them, and not as many as its blocks."""
    change = np.repeat([0.3, 0.1, 0.4, 0.2], N // 4)[None]
    brief = Scored("v", RESPONSE + NOISE, RESPONSE - change, RESPONSE, np.zeros(1))
    ses = [gain_of(replace(brief, memory=m), EVERYWHERE, True, DT).se for m in (1.0, 15.0)]
    assert ses[1] > 1.5 * ses[0]


def test_one_event_does_not_outweigh_all_that_a_cause_explains():
    before, after = np.full((1, T.size), 0.1), np.zeros((1, T.size))
    after[:, :100] = 2.0
    scored = Scored("v", RESPONSE, RESPONSE - before, RESPONSE - after, np.zeros(1))
    gain = gain_of(scored, np.ones((1, T.size), bool), True, DT)
    assert gain.after < gain.before and gain.typical > 0.99
