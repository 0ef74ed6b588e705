"""Regressors as C source; symbolic expressions are CasADi's, which only some files here import."""
