"""Smooth data with known errors for all tests of this room."""

from smooth_data import make_errors, make_regressor, make_samples

__all__ = ["make_errors", "make_regressor", "make_samples"]
