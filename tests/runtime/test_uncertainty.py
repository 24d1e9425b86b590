"""The uncertainty that a node states of what moves: never below its true error, never faster than the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import DOUBLE, OSCILLATOR, PERIOD, STATIC, case
from trigpoint.observers.aged import settling
from trigpoint.runtime import Mute, NodeMachine, Trouble, run_virtual
from trigpoint.runtime.knowledge import Pull, averaged, cautious
from trigpoint.runtime.latched import free_growth, is_mean


def watched(one, trouble=None, *, deviation: float = 0.0, until: float = 12.0, seed: int = 0, **options):
    """(T, N) true errors a state, and what the nodes say they are."""
    biggest = float(np.linalg.norm(one.error, axis=1).max() / np.sqrt(one.error.shape[1]))
    rate, overshoot = settling(one.observer.as_programs(), PERIOD, PERIOD, PERIOD, one.observer.decay_rate)
    deviations = {label: deviation for program in one.programs for label in program.reads}
    given = {"settle_rate": rate, "overshoot": overshoot, **options}
    settings = one.settings(start_uncertainty=biggest, deviations=deviations, **given)
    plant = one.plant(deviations=deviations if deviation else None, seed=seed)
    network = one.network(delay=0.008, jitter=0.004, loss=0.05, seed=seed)
    errors, figures = [], []

    def watch(now: float, machines) -> None:
        apart = [machines[name].estimate_at(now) - x for name, x in zip(one.names, plant.truth(), strict=True)]
        errors.append(np.linalg.norm(apart, axis=1) / np.sqrt(one.error.shape[1]))
        figures.append([machines[name].knowledge.uncertainty for name in one.names])

    run_virtual(settings, plant, PERIOD * np.arange(1, round(until / PERIOD), 3), network, trouble, watch)
    return np.array(errors), np.array(figures), settings[0]


@pytest.mark.parametrize("deviation", [0.0, 0.1])
@pytest.mark.parametrize("agent", [OSCILLATOR, DOUBLE])
def test_the_figure_of_what_moves_is_at_least_its_error(agent, deviation) -> None:
    errors, figures, _ = watched(case(agent, seed=4), deviation=deviation)
    assert (errors <= figures).all()
    if not deviation:
        assert figures[-1].max() < 0.2 * figures[0].max()  # and it says something


@pytest.mark.slow
@pytest.mark.parametrize("agent", [OSCILLATOR, DOUBLE])
@pytest.mark.parametrize("seed", range(6))
def test_the_figure_holds_from_many_starts(agent, seed) -> None:
    one = case(agent, seed=seed)
    if seed < agent.n_states:  # everybody wrong in one state, in the same direction
        one.error[:] = np.eye(agent.n_states)[seed]
    errors, figures, _ = watched(one, deviation=0.05 * (seed % 2), until=40.0, seed=seed)
    assert (errors <= figures).all()


def test_it_falls_by_the_rate_at_most_and_only_while_covered() -> None:
    anchor = next(arc.label for arc in case().programs[0].arcs if not arc.heard)
    errors, figures, settings = watched(case(), Trouble(mutes=[Mute(anchor, 4.0, 8.0)]), until=10.0)
    least = np.exp(-settings.settle_rate * 3.0 * PERIOD)
    assert (figures[1:] >= figures[:-1] * least * (1.0 - 1e-9)).all()
    away = slice(round(5.6 / (3 * PERIOD)), round(8.0 / (3 * PERIOD)))  # relative, after the timeout
    assert (np.diff(figures[away], axis=0) >= -1e-12).all()
    assert (errors <= figures).all()


def test_without_a_rate_it_does_not_fall() -> None:
    _, figures, settings = watched(case(), settle_rate=0.0, overshoot=1.0, until=4.0)
    assert figures.min() >= settings.start_uncertainty


def test_one_step() -> None:
    pulls = [Pull(3.0, 0.5), Pull(1.0, 0.0)]
    assert cautious(2.0, pulls, 0.1, rate=0.5, growth=0.7) == pytest.approx(2.0 * np.exp(-0.05))
    assert cautious(0.1, pulls, 0.1, rate=0.5, growth=0.7) == averaged(0.1, pulls, 0.1) > 0.1
    assert cautious(2.0, [], 0.1, rate=0.5, growth=0.7) == pytest.approx(2.0 * np.exp(0.07))
    assert np.isfinite(cautious(1.0, [], 1e9, rate=0.0, growth=1.0))


def test_alone_the_error_grows_no_faster_than_the_figure() -> None:
    """A node that hears nobody: two states that drift apart."""
    one = case(DOUBLE)
    settings = replace(one.settings(start_uncertainty=1.0)[4], start=np.zeros(2))
    machine = NodeMachine(settings, epoch=1, now=0.0)
    truth = np.array([1.0, 1.0])
    for k in range(1, 200):
        machine.act(k * PERIOD)
        machine.latch(k * PERIOD)
        error = np.linalg.norm(machine.state.estimate - truth - [k * PERIOD, 0.0]) / np.sqrt(2.0)
        assert error <= machine.knowledge.uncertainty * (1.0 + 1e-9)
    assert machine.knowledge.uncertainty == pytest.approx(np.exp(0.5 * 199 * PERIOD), rel=1e-6)


def test_who_takes_means() -> None:
    still = case(STATIC).settings()[0]
    moving = case().settings()[0]
    assert is_mean(still)
    assert not is_mean(moving)
    assert not is_mean(replace(still, models={"b": np.eye(2)}))  # a neighbour that moves
    assert not is_mean(replace(still, program=replace(still.program, exchange="euler", _memo={})))
    turned = replace(still.program.arcs[0], gain=still.program.arcs[0].gain @ np.diag([1.0, 2.0]))
    assert not is_mean(replace(still, program=replace(still.program, arcs=(turned,), _memo={})))
    assert free_growth(moving.program) == 0.0
    assert free_growth(case(DOUBLE).programs[0]) == pytest.approx(0.5)
    assert free_growth(replace(case(DOUBLE).programs[0], exchange="discrete", _memo={})) == 0.0


def test_the_machine_says_the_overshoot_at_the_start_and_after_a_reset() -> None:
    settings = case().settings(start_uncertainty=2.0, overshoot=1.5)[0]
    assert NodeMachine(settings, epoch=1, now=0.0).knowledge.uncertainty == 3.0
    assert settings.first_uncertainty == 3.0
    worst = case(gain=tp.methods.WorstCase(9)).observer.as_programs()
    rate, overshoot = settling(worst, PERIOD, PERIOD, PERIOD, worst.decay_rate)
    assert 0.0 < rate <= worst.decay_rate
    assert overshoot > 1.0
