"""The guard: whoever dies, the bench ends with power off, at a safe set-point, with the stage at rest."""
