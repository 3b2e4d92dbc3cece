"""Fixtures of the guard's tests."""

from real_processes import forked_guards, lab, make_module_stand, make_stand, run_test

__all__ = ["forked_guards", "lab", "make_module_stand", "make_stand", "run_test"]
