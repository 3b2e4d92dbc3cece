"""Independent work among several processes gives what one process gives, whatever becomes of the others."""

import multiprocessing
import os
import signal

import pytest

from arl_fixtures.reconcile.shared_work import cores, each, processes

HERE = os.getpid()
PATIENCE_S = 60.0


@pytest.fixture
def meet():
    """Work of which each of two processes begins some, so that neither does all of it alone."""
    both = multiprocessing.get_context("fork").Barrier(2)
    met = []

    def meet(item):
        if not met:
            met.append(item)
            both.wait(PATIENCE_S)
        return item, os.getpid()

    return meet


def test_results_come_in_order_from_more_than_one_process(meet):
    with processes(2):
        found = each(meet, range(20))
    assert [item for item, _ in found] == list(range(20))
    assert len({process for _, process in found}) == 2


def test_nothing_is_forked_unless_asked():
    assert each(lambda _: os.getpid(), range(4)) == 4 * [HERE]


def test_what_both_sides_hold_stays_the_same_object(meet):
    held, copied = object(), []
    with processes(2):
        found = each(lambda item: {"held": held, "copied": copied, "at": meet(item)[1]}, range(8), known=[held])
    assert all(one["held"] is held for one in found)
    assert {one["copied"] is copied for one in found} == {True, False}


@pytest.mark.parametrize("what", ["dies", "cannot be sent", "fails"])
def test_what_another_process_owes_is_worked_on_here(meet, what):
    def work(item):
        meet(item)
        if os.getpid() != HERE:
            if what == "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            if what == "fails":
                raise ValueError(item)
            return lambda: item
        return item

    with processes(2):
        assert each(work, range(6)) == list(range(6))


def test_an_error_is_met_where_the_work_was_asked_for(meet):
    def work(item):
        if meet(item)[0] == 3:
            raise ValueError(f"item {item}")
        return item

    with processes(2), pytest.raises(ValueError, match="item 3"):
        each(work, range(6))


def test_work_within_work_is_not_shared_again(meet):
    def work(item):
        inner = each(lambda _: os.getpid(), range(8)) if meet(item)[1] != HERE else [os.getpid()]
        return set(inner) == {os.getpid()}

    with processes(2):
        assert all(each(work, range(4)))


def test_a_program_with_threads_of_its_own_is_not_forked(monkeypatch):
    monkeypatch.setattr("threading.active_count", lambda: 2)
    assert cores() == 1
