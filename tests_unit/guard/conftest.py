"""Fixtures of the guard's tests."""

from real_processes import lab, make_module_stand, make_stand, run_test

__all__ = ["lab", "make_module_stand", "make_stand", "run_test"]
