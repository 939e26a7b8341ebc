"""Check that stated uncertainties hold, also where an assumption of the solver is broken on purpose."""
